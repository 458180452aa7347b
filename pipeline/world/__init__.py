"""A simulated place over fifteen months, and the raw logs that a real robot would have recorded there.

It is tuned for physical plausibility alone, never so that a method wins. Nothing outside this package may know that a log
is simulated: the pipeline reads the files.

streets, ground → blocks (buildings, greenery) → campus → plan, routes → events → day
robots (motion, lidar) → drive → raycast → recorder → writers, one a format
"""
