"""Keeps freed memory in this process, so that large arrays are allocated faster."""

import ctypes

M_TRIM_THRESHOLD = -1
M_MMAP_THRESHOLD = -3  # of malloc.h


def keep_freed_memory() -> None:
    """Let glibc reuse large arrays instead of asking the kernel for zeroed pages each time.

    It saves a fifth of a training's CPU time, and half of the time to read a scan of 2 MB and draw
    it. It holds for the whole process, which then stays as large as it once was. Without glibc
    nothing is done.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        for parameter, value in ((M_MMAP_THRESHOLD, 2**30), (M_TRIM_THRESHOLD, 2**31 - 1)):
            libc.mallopt(parameter, value)
