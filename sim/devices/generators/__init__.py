"""Emulated generators of other families than Keysight's 33500B and 33600A, one module each."""
