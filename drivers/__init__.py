"""Real instruments, spoken to over VISA, serial lines and USB."""
