"""Physics, and instruments made of it."""
