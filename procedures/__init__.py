"""One question about a receiver per module."""
