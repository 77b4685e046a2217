"""Planners: from a view of the world, a start and a goal to a polyline."""
