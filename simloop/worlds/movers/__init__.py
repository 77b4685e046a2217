"""Things that move by themselves: their settings and their true motion."""
