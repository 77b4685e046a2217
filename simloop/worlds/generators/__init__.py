"""Worlds and clutter that are drawn from a seed."""
