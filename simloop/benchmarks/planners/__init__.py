"""Planners compared on equal terms: tasks -> trials -> figures, tests of significance, a report.

One judge for all: J is worked out anew from the waypoints, the clearance by numpy code that shares
nothing with the planners' kernels. Nothing here is ever used in a decision of the robot's.
"""
