"""What the poses of single queries and the odometry of a drive tell together (METHODS 9.9)."""
