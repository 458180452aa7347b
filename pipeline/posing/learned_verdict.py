"""The results of the validation blocks of a training day: the verdict, and settings of the search.

The stage `poses` writes them as an artifact, and `yearloc pack` reads it, so that the blocks are
registered only once.
"""

import json
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

import numpy as np

from pipeline.core import store
from pipeline.core.schemas import Verdicts
from pipeline.posing.covariances import CovarianceModel
from pipeline.posing.expectations import Expectations
from pipeline.posing.probabilities import HypothesisModel
from pipeline.posing.search import Fixer
from pipeline.posing.verdict import CLAIMS, FixEvidence, Judge, Verdict

VERDICT = "verdict"
"""The name of the artifact, beside the fixes of each sequence."""


@dataclass(frozen=True)
class Learned:
    """The verdict of a training day, and the settings of the search learned from its blocks."""

    verdict: Verdict
    fix_count: int
    """The number of validation fixes that the verdict was learned from."""
    least_overlap: float = 0.0
    """Approaches with at least this overlap are refined (Fixer.least_overlap)."""
    expectations: Expectations = field(default_factory=Expectations)
    """The features of right fixes, place by place."""

    @classmethod
    def of(cls, evidence: FixEvidence[Any], verdict: Verdict) -> Self:
        """A verdict, with what the search learns from its evidence."""
        return cls(verdict, len(evidence.fixes), evidence.least_overlap, evidence.expectations)

    @classmethod
    def read(cls, path: Path | None, basis: str) -> Self | None:
        """Read the artifact at a path; None if there is none, or if its basis is another."""
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
            HypothesisModel(tuple(artifact.load("pose_weights").tolist()), artifact.pose_offset),
            HypothesisModel(tuple(artifact.load("place_weights").tolist()), artifact.place_offset),
            artifact.target_precisions,
            dict(zip(CLAIMS, thresholds, strict=True)),
            artifact.validation_blocks,
            artifact.unseen_share,
            covariances=_covariance_model(artifact),
        )
        expectations = Expectations(
            artifact.load("expected_xy_m"), artifact.load("expected_features")
        )
        return cls(verdict, artifact.fix_count, artifact.least_overlap, expectations)

    def write(self, path: Path, basis: str) -> None:
        """Write the artifact; `basis` describes what it was learned with (see `basis` below)."""
        verdict = self.verdict
        model = verdict.covariances
        artifact = Verdicts(
            pose_weights=np.array(verdict.pose.weights),
            place_weights=np.array(verdict.place.weights),
            expected_xy_m=self.expectations.xy_m,
            expected_features=self.expectations.features,
            covariance_typical=np.array(model.typical if model else ()),
            covariance_scales=np.array(model.scales if model else ()),
            covariance_power=model.power if model else 1.0,
            pose_offset=verdict.pose.offset,
            place_offset=verdict.place.offset,
            target_precisions=verdict.target_precisions,
            pose_thresholds=verdict.claim_thresholds["fix"],
            place_thresholds=verdict.claim_thresholds["place"],
            several_thresholds=verdict.claim_thresholds["several"],
            validation_blocks=verdict.validation_blocks,
            unseen_share=verdict.unseen_share,
            fix_count=self.fix_count,
            least_overlap=self.least_overlap,
            basis=basis,
        )
        store.write(path, artifact)

    def tuned(self, fixer: Fixer) -> Fixer:
        """The search with the settings learned from the validation blocks."""
        return replace(
            fixer,
            model=self.verdict.pose,
            least_overlap=self.least_overlap,
            expectations=self.expectations,
        )

    @property
    def judge(self) -> Judge:
        """The judge of later fixes of 3-D scans."""
        return Judge(self.verdict.pose, self.verdict.place)


def _covariance_model(artifact: Verdicts) -> CovarianceModel | None:
    """The model of covariances in an artifact; None if it has none."""
    typical = tuple(artifact.load("covariance_typical").tolist())
    scales = tuple(artifact.load("covariance_scales").tolist())
    return CovarianceModel(typical, scales, artifact.covariance_power) if typical else None


def basis(content: bytes, **settings: Any) -> str:
    """The basis of a verdict, as JSON: the digest of the model or map, and the settings."""
    digest = sha256(content).hexdigest()
    return json.dumps({"digest": digest, **settings}, sort_keys=True)
