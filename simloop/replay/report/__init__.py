"""The page of a replay: its map beside the reference, its errors over time, its figures."""
