"""What surrounds the robot in the closed loop: random streams, environment and sensor suite."""
