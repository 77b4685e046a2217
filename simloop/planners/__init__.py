"""The planners: one protocol, many methods, each chosen by name."""
