"""Worlds: obstacles, ground and movers, as a description (``layout``) and compiled (``world``).

A generator, a map, a Gazebo world or an MJCF arena -> Layout -> compile_world -> World
"""
