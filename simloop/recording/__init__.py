"""Recordings for the rerun viewer and pictures of a run; nothing here can change a run."""
