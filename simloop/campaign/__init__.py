"""Many runs: scenarios x seeds x planners x sweeps, over processes or a cluster, resumable.

Request -> RunSpec... -> Executor -> journal -> results.parquet -> report, thresholds, JUnit
"""
