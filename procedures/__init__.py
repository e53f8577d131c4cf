"""A room of belahil: procedures, one question about a receiver per module."""
