"""What validation blocks of the training day teach: the verdict, and what the search takes from it.

The stage `poses` writes it as an artifact, `yearloc pack` reads that: blocks are registered once.
"""

import json
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

import numpy as np

from pipeline.core import store
from pipeline.core.schemas import Verdicts
from pipeline.posing.expectations import Expectations
from pipeline.posing.probabilities import Probabilities
from pipeline.posing.search import Fixer
from pipeline.posing.verdict import CLAIMS, FixEvidence, Judge, Verdict

VERDICT = "verdict"
"""The name of the artifact, beside the fixes of each sequence."""


@dataclass(frozen=True)
class Learned:
    """The verdict of a training day, and what the search takes from validation blocks."""

    verdict: Verdict
    fix_count: int
    """How many fixes of validation queries it was learned from."""
    least_overlap: float = 0.0
    """The overlap from which on an approach is refined."""
    expectations: Expectations = field(default_factory=Expectations)
    """The features of right fixes, place by place."""

    @classmethod
    def of(cls, evidence: FixEvidence[Any], verdict: Verdict) -> Self:
        """What the evidence teaches besides its verdict."""
        return cls(verdict, len(evidence.fixes), evidence.least_overlap, evidence.expectations)

    @classmethod
    def read(cls, path: Path | None, basis: str) -> Self | None:
        """Read an artifact; None if there is none, or it was learned with another basis."""
        if path is None or not path.is_dir():
            return None
        artifact = store.read(path, Verdicts)
        if artifact.basis != basis:
            return None
        thresholds = (
            artifact.pose_thresholds,
            artifact.place_thresholds,
            artifact.several_thresholds,
        )
        verdict = Verdict(
            Probabilities(tuple(artifact.load("pose_weights").tolist()), artifact.pose_offset),
            Probabilities(tuple(artifact.load("place_weights").tolist()), artifact.place_offset),
            artifact.target_precisions,
            dict(zip(CLAIMS, thresholds, strict=True)),
            artifact.validation,
            artifact.unseen_share,
        )
        expectations = Expectations(
            artifact.load("expected_xy_m"), artifact.load("expected_features")
        )
        return cls(verdict, artifact.fix_count, artifact.least_overlap, expectations)

    def write(self, path: Path, basis: str) -> None:
        """Write the artifact; `basis` says what it was learned with."""
        verdict = self.verdict
        artifact = Verdicts(
            pose_weights=np.array(verdict.pose.weights),
            place_weights=np.array(verdict.place.weights),
            expected_xy_m=self.expectations.xy_m,
            expected_features=self.expectations.features,
            pose_offset=verdict.pose.offset,
            place_offset=verdict.place.offset,
            target_precisions=verdict.target_precisions,
            pose_thresholds=verdict.claim_thresholds["fix"],
            place_thresholds=verdict.claim_thresholds["place"],
            several_thresholds=verdict.claim_thresholds["several"],
            validation=verdict.validation,
            unseen_share=verdict.unseen_share,
            fix_count=self.fix_count,
            least_overlap=self.least_overlap,
            basis=basis,
        )
        store.write(path, artifact)

    def tuned(self, fixer: Fixer) -> Fixer:
        """The search with what it takes from the validation blocks."""
        return replace(
            fixer,
            probabilities=self.verdict.pose,
            least_overlap=self.least_overlap,
            expectations=self.expectations,
        )

    @property
    def judge(self) -> Judge:
        """The judge of later fixes of 3-D scans."""
        return Judge(self.verdict.pose, self.verdict.place)


def basis(content: bytes, **settings: Any) -> str:
    """What a verdict was learned with, as JSON: the digest of a model or map, and settings."""
    digest = sha256(content).hexdigest()
    return json.dumps({"digest": digest, **settings}, sort_keys=True)
