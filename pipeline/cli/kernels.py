"""Tells the user that kernels are compiled before the first scan."""

import sys

import pipeline
from pipeline.kernel_cache import CACHE_VARIABLE, cold


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
    from pipeline.views.kernels import bin_heights  # which every first scan needs

    if cold(bin_heights):
        folder_note = (
            f", kept in {pipeline.KERNELS}: set {CACHE_VARIABLE} to a folder that lasts"
            if pipeline.KERNELS
            else ""
        )
        print(
            f"  compiling kernels, once per machine: half a minute{folder_note}",
            file=sys.stderr,
            flush=True,
        )
