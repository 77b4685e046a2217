"""The robot's surroundings in the closed loop: random streams, environment and sensor suite."""
