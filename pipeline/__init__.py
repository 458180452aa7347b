"""The library of yearloc: learn a place from LiDAR on one day, localise in it for a year.

Importing it chooses the folder of compiled kernels, before any module defines a kernel.
"""

from pipeline.kernel_cache import choose_folder

KERNELS = choose_folder()
"""The temporary folder where compiled kernels are kept, or "nowhere" if they cannot be kept.

It is empty in the usual case, in which numba finds a folder by itself.
"""
