"""What is said of kernels that are still to be compiled."""

import sys

import pipeline
from pipeline.kernel_cache import CACHE_VARIABLE, cold


def tell_cold() -> None:
    """Say so once, if the first scan takes so much longer than the others."""
    if pipeline.KERNELS == "nowhere":
        print(
            f"  compiling kernels, at every start: half a minute; set {CACHE_VARIABLE} to a "
            "folder to keep them",
            file=sys.stderr,
            flush=True,
        )
        return
    if cold():
        kept = (
            f", kept in {pipeline.KERNELS}: set {CACHE_VARIABLE} to a folder that lasts"
            if pipeline.KERNELS
            else ""
        )
        print(
            f"  compiling kernels, once per machine: half a minute{kept}",
            file=sys.stderr,
            flush=True,
        )
