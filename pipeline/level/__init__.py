"""Level: from the sweeps of a 2-D laser to where the robot stands, and whether to believe it.

The pose has three degrees of freedom. One module a step:

    level_map     which cells of a building are walls, free, or unknown
    field         how near a wall each cell is, and a pyramid of maxima over it
    sweeps        sweeps of one stretch of path, joined by matched odometry
    search        branch and bound over the whole map
    refinement    the best poses refined to less than a cell
    beams         what the map then says for and against a pose
    fix           the hypotheses that are left
    verdict       the chance that a fix is right, and where a promise is kept
    held_out      fixes of stretches of the training day, from which a verdict learns
"""
