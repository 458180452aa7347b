"""pySeqSLAM's match of each image of a drive in another: `PYTHONPATH=pySeqSLAM python seqslam.py
IMAGES ROWS OUT`."""

import sys
import time

import numpy as np
from pyseqslam.parameters import defaultParameters  # type: ignore[import-not-found]
from pyseqslam.seqslam import SeqSLAM  # type: ignore[import-not-found]

images, rows, out = sys.argv[1:]
pixels = (
    np.fromfile(images, np.uint8).reshape(2, int(rows), -1).astype(np.float64)
)  # its differences of bytes would wrap around
slam = SeqSLAM(defaultParameters())
start = time.process_time()
enhanced = slam.enhanceContrast(slam.getDifferenceMatrix(pixels[0].T, pixels[1].T))
matched = slam.getMatches(enhanced)[:, 0]
print((time.process_time() - start) * 1000)
np.nan_to_num(matched, nan=-1).astype("<i4").tofile(out)
