"""Metaheuristics: one population engine, and one file for each family of update rules."""
