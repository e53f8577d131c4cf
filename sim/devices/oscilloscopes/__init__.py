"""Oscilloscopes that speak SCPI, one module for each family."""
