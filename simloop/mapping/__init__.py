"""The robot's map: an occupancy grid, the matching of scans to it, and map files."""
