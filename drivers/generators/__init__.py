"""Function generators: a thin dialect for each family."""
