"""Comparison of planners on equal terms: tasks, trials, figures, significance tests, a report.

One judge rates all planners. It recomputes J from the waypoints, and clearance with numpy code that
is independent of the planners' kernels. The robot never uses these results in a decision.
"""
