"""Measurements of the software: speed of the loop, planners, mapper, handling of faults.

Nothing here takes part in a decision of the robot.
"""
