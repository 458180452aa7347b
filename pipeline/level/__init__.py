"""Localises a robot by the sweeps of a level 2-D laser, and judges the answer (METHODS 13).

A pose is x, y and heading. One module does one step:

    level_map     which cells of a building are walls, free, or unknown field         how near a
    wall each cell is, and a pyramid of maxima over it sweeps        joins the sweeps of one stretch
    of path, by odometry and matching search        finds the best poses in the whole map, by branch
    and bound refinement    refines these to less than a cell beams         follows beams through
    the map, for and against a pose fix           runs these steps; the poses that a query may have
    come out, likeliest first verdict       the probability that a fix is right, and from which
    error probability on to reject it validation      localises stretches of the training day, to
    test a verdict on day           what is known of a building after its training day: map and
    verdict
"""
