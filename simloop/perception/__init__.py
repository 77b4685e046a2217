"""What the robot perceives beside its map: moving things, and obstacles too low for the LiDAR."""
