"""Things that move by themselves: what a scenario says of them, and how they truly go."""
