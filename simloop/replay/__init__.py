"""Replay of recorded logs of real robots through the matcher and the mapper of ``graph_slam``."""
