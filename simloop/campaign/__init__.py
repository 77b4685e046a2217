"""Many runs of scenarios with several planners, settings and seeds, and what they show.

Request -> RunSpec... -> pool of workers -> journal -> results.parquet -> report, verdicts, JUnit.
"""
