"""Campaigns: many runs of scenarios with several planners, settings and seeds, and their results.

Request -> RunSpec... -> pool of workers -> journal -> results.parquet -> report, verdicts, JUnit.
"""
