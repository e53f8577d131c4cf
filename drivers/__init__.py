"""A room of belahil: real instruments, spoken to over VISA, serial lines and USB."""
