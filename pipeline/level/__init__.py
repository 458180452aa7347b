"""Localises a robot by the sweeps of a level 2-D laser, and judges the answer (METHODS 13).

A pose is x, y and heading. Each module does one step:

    level_map     which cells of a building are walls, free, or unknown
    field         the distance of each cell to the nearest wall, and a pyramid of likelihoods
    sweeps        joins the sweeps of the last metres of path, by odometry and matching
    search        finds the best poses in the whole map, by branch and bound
    refinement    refines these poses to less than a cell
    beams         follows beams through the map: evidence for and against a pose
    fix           runs these steps; returns the poses that a query may have
    verdict       the probability that a fix is right, and when to reject it
    validation    localises stretches of the training day, as evidence for a verdict
    day           a building after its training day: map and verdict
"""
