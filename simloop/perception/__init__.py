"""Perception beside the map: moving obstacles, and obstacles that the LiDAR cannot see."""
