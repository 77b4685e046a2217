"""Navigation: planning, gap choice, smoothing and goal feasibility."""
