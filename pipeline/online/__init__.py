"""A site localises scans on a robot: packing, localising, tracking, serving (METHODS 10)."""
