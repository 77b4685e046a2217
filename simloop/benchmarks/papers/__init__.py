"""``simloop bench papers``: the vehicle drives with every planner, and in every paper's worlds."""
