"""Posing: from the ranked places of a query to its pose, and whether to accept it (METHODS 9).

The pose has six degrees of freedom. The modules, in the order of the steps:

    targets       the training submaps of a map, and which of them are candidates
    walls         scores candidates by their walls from above, at all headings
    registration  aligns the query with the best candidates, point by point
    verification  what the map then says for and against a pose
    aliases       other poses near a pose at which the query would fit as well
    search        all these steps for one query
    probabilities how likely each pose is right, by its features
    fix           the poses of a query, the likeliest first
    queries       the fixes of a test sequence
    validation    the fixes of validation blocks of the training day, as evidence
    verdict       learns from this evidence how probable a fix is, and when to reject it
    answers       the ranking, with the registered poses first
"""
