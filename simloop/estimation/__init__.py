"""State estimation: filter models, odometry, health monitoring, and relocalisation."""
