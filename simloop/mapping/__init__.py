"""Occupancy grid of the robot, the matching of scans to it, and map files."""
