"""A site, which localises scans on a robot: packed, asked, followed, served, shown (METHODS 10)."""
