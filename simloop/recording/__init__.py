"""Recordings for the rerun viewer, and pictures of a run. Nothing here can change a run."""
