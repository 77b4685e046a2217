"""State estimation: the filter's models, odometry, health, and finding a lost robot."""
