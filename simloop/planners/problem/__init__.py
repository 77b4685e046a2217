"""The problem that all planners share: clearance, objective, bends, account of a plan."""
