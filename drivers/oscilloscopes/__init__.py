"""Oscilloscopes as digitizers: one driver, and a dialect for each family."""
