"""Benchmarks: speed of the loop, planners, mapper, handling of faults.

The robot never uses these measurements in a decision.
"""
