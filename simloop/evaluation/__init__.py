"""Evaluation of a run: its outcome, its metrics and the references to compare them with."""
