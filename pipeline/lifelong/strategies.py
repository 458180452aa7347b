"""Strategies: what becomes of a model when a further day has been surveyed (METHODS 11.4)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.core.progress import Progress
from pipeline.core.settings import SomeShare, check
from pipeline.matching.ranking import Method, Model, TrainingSet


@dataclass(frozen=True)
class Frozen:
    """Leaves the model as it is."""

    def learn(
        self,
        method: Method,
        model: Model,
        known_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Return the model itself."""
        return model


@dataclass(frozen=True)
class Joint:
    """Trains a new model on all days: what growth is measured by."""

    def learn(
        self,
        method: Method,
        model: Model,
        known_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Train on all days from the beginning."""
        return method.learn(*TrainingSet.joined([known_views, new_views]), progress)


@dataclass(frozen=True)
class Grown:
    """Lets the model learn the new day without forgetting the earlier ones."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the method that are changed for growth."""

    def learn(
        self,
        method: Any,
        model: Model,
        known_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Grow the model by the new views."""
        grown: Model = replace(method, **self.settings).grow(
            model, known_views, new_views, progress
        )
        return grown


@dataclass(frozen=True)
class Updated:
    """Lets a site adopt what it localises of a day that nobody surveyed."""

    promise: SomeShare | None
    """The promise that a fix must keep to be adopted; None adopts every scan with a pose."""

    def __post_init__(self) -> None:
        check(self, "strategy")
