"""Recorded logs of real robots through the same matcher and mapper that the closed loop uses."""
