"""Incremental learning: updates of a site, and the comparison of strategies (METHODS 11)."""
