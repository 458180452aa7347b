"""Estimates as artifacts."""

from pipeline.core import schemas
from pipeline.slam.drive import Estimate


def artifact(estimate: Estimate) -> schemas.Estimates:
    """The artifact of an estimate."""
    loops = estimate.loops
    return schemas.Estimates(
        stamps_ns=estimate.stamps_ns,
        odom_T_scan=estimate.odom_T_scan,
        world_T_scan=estimate.world_T_scan,
        overlap=estimate.overlap,
        by_log=estimate.by_log,
        breaks=estimate.breaks,
        fixed=estimate.fixed,
        earlier=loops.earlier,
        later=loops.later,
        earlier_T_later=loops.earlier_T_later,
        residual_m=loops.residual_m,
        residual_deg=loops.residual_deg,
        used=loops.used,
        skipped=dict(estimate.skipped),
    )
