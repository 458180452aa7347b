"""Poses of a log that has none: odometry by registration, loops, and a graph that joins them."""
