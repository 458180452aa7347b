"""Speed as ratios to peers measured in the same run: `python -m benchmarks`."""

import os

os.environ.update(
    OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1"
)  # before numpy is imported: one thread
