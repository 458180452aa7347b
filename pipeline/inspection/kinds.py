"""Lists every kind of artifact that stages write, in the order of docs/artifacts.md.

`KINDS` has the class of each kind, with its schema, by the name in the artifact's attributes.
"""

from pipeline.core.schemas import (
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
from pipeline.core.store import Artifact
from pipeline.evaluation.judgement import Evaluations
from pipeline.evaluation.viewpoints import ViewpointMatches

KINDS: dict[str, type[Artifact]] = {
    schema.kind: schema
    for schema in (
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
