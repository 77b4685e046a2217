"""Worlds that are no MJCF: drawn from a seed, or read from others' files.

[generator], map.yaml, room.world -> Layout (bounds, obstacles) -> arena.build
"""
