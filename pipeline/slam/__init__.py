"""Estimates the poses of a log that has none: by odometry, loops, and a graph that joins both."""
