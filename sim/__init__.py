"""A room of belahil: physics, and instruments made of it."""
