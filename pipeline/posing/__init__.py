"""Posing: from the ranked places of a query to where it stands, and whether to believe it.

The pose has six degrees of freedom. One module a step:

    targets       the training submaps of a map, and which of them are candidates
    walls         candidates scored from above, at all headings
    registration  the best of them refined point by point
    verification  what the map then says for and against it
    fix           the hypothesis that is left, and the runners-up
    queries       fixes of a test sequence
    held_out      fixes of blocks of the training day, from which a verdict learns
    verdict       the chance that a fix is right, and where a promise is kept
    answers       the ranking, led by what was registered
"""
