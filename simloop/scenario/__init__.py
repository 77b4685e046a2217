"""Scenarios: the files that describe a run, their errors, and the worlds that they describe."""
