"""Learning further days: a site that grows, and the study of how localisers do (METHODS 11)."""
