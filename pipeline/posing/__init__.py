"""Posing: from the ranked places of a query to where it stands, in six degrees of freedom, and whether to believe it.

walls        candidates scored from above, at all headings: where could the query stand in this training submap?
registration the best of them refined point by point
verification what the map then says for and against it
fix          the hypothesis that is left, and the runner-up
"""
