"""Comparison of planners on equal terms: tasks, trials, figures, significance tests, a report.

One judge rates all planners: J is recomputed from the waypoints, clearance by numpy code that
shares nothing with the planners' kernels. No result is ever used in a decision of the robot.
"""
