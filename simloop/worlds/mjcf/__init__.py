"""Read the MJCF file of an arena, check it, and join it with the vehicle."""
