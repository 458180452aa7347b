"""Decodes a scan sent over a network, for the HTTP server (serve.py) and Zenoh (bridge.py)."""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD
from pipeline.formats.messages import from_cdr, header
from pipeline.formats.pointcloud2 import decode

FLOATS = "application/octet-stream"
"""The content type of a body of little-endian float32 x, y, z."""
CDR = "application/cdr"
"""The content type of a sensor_msgs/PointCloud2, serialised as ROS 2 sends it."""
LARGEST_BYTES = 32 * 2**20
"""The largest body that is accepted: 2.7 million points."""


def points(body: bytes, kind: str) -> tuple[int | None, NDArray[np.float64]]:
    """Decode a body of the content type `kind`: its stamp in ns, and its points (n, 3) in metres.

    The stamp is None if the body has no stamp; any type but CDR is read as FLOATS. Raises LogError
    for a body that is no scan.
    """
    if len(body) > LARGEST_BYTES:
        raise LogError(f"a scan of more than {LARGEST_BYTES:,} bytes")
    if kind == CDR:
        stamp_ns, _ = header(body, 2)  # of ROS 2
        return stamp_ns, np.asarray(decode(from_cdr(body, CLOUD)), np.float64)
    if len(body) % 12:
        raise LogError(f"{len(body)} bytes are no whole number of float32 x, y, z")
    return None, np.frombuffer(body, "<f4").reshape(-1, 3).astype(np.float64)
