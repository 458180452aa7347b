"""Every kind of artifact, as docs/artifacts.md lists them."""

from pipeline.evaluation.judgement import Evaluations
from pipeline.evaluation.viewpoints import ViewpointMatches
from pipeline.schemas import (
    VIEW_KINDS,
    Estimates,
    Fixes,
    Labels,
    Lifelong,
    Maps,
    Rankings,
    Scans,
    Submaps,
)
from pipeline.store import Artifact

KINDS: dict[str, type[Artifact]] = {
    kind.kind: kind
    for kind in (
        Estimates,
        Scans,
        Submaps,
        *VIEW_KINDS,
        Labels,
        Maps,
        Rankings,
        Fixes,
        Evaluations,
        ViewpointMatches,
        Lifelong,
    )
}
