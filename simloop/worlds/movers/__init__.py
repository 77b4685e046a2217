"""Things that move by themselves: their settings, and how they truly move."""
