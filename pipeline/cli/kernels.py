"""`yearloc kernels` compiles the kernels that the first scan would wait for, once per machine.

Kernels are functions that numba compiles to machine code when they are first called. Commands that
localise call `tell_cold`, so that the user knows why the first scan takes half a minute.
"""

import sys

import pipeline
from pipeline.kernel_cache import CACHE_VARIABLE, cold


def kernels() -> None:
    """Compile the kernels of localisation, once per machine; `make install` does it too."""
    from pipeline.online.first import compile_kernels

    print("compiling what a first scan takes, once per machine", file=sys.stderr, flush=True)
    print(f"compiled in {compile_kernels():.0f} s")


def tell_cold() -> None:
    """Print a line if the first scan will wait half a minute for kernels to be compiled."""
    if pipeline.KERNELS == "nowhere":
        print(
            f"  compiling kernels, at every start: half a minute; set {CACHE_VARIABLE} to a "
            "folder to keep them",
            file=sys.stderr,
            flush=True,
        )
        return
    from pipeline.views.kernels import bin_heights  # every first scan needs this kernel

    if cold(bin_heights):
        folder_note = ""
        if pipeline.KERNELS:
            folder_note = (
                f", kept in {pipeline.KERNELS}: set {CACHE_VARIABLE} to a folder that lasts"
            )
        print(
            f"  compiling kernels, once per machine: half a minute{folder_note}",
            file=sys.stderr,
            flush=True,
        )
