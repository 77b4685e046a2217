"""``simloop bench logs``: the recorded logs of a folder are mapped with the same settings."""
