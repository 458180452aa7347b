"""Joins the fixes of a drive's queries, each found alone, with its odometry (METHODS 9.9)."""
