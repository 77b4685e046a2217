"""Random worlds and obstacles, drawn from a seed."""
