"""Learn a place from LiDAR on one day, localise in it for a year."""

from pipeline.kernel_cache import settle

KERNELS = settle()
"""A temporary folder where compiled kernels are kept, or "nowhere"; empty where they are kept as
usual."""
