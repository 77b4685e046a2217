"""A run described: scenario files, their errors, and the world that they describe."""
