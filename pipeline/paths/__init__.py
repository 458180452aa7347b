"""Joins the poses of single queries with the odometry of their drive (METHODS 9.9)."""
