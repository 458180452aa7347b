"""Strategies (METHODS 11.4): a model, the views it learned and a further day's in; a model out.

The last one, `Updated`, is a site's own: it says which scans of a day the site learns by itself.
"""

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
        learned_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Return the model itself."""
        return model


@dataclass(frozen=True)
class Joint:
    """Trains a new model on all days: the best that growth could reach."""

    def learn(
        self,
        method: Method,
        model: Model,
        learned_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Train on all days from the beginning."""
        return method.learn(*TrainingSet.joined([learned_views, new_views]), progress)


@dataclass(frozen=True)
class Grown:
    """Lets the model learn the new day without forgetting the earlier ones."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the method that are changed for growth."""

    def learn(
        self,
        method: Any,
        model: Model,
        learned_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Grow the model by the new views."""
        grown: Model = replace(method, **self.settings).grow(
            model, learned_views, new_views, progress
        )
        return grown


@dataclass(frozen=True)
class Updated:
    """Lets a site adopt what it localises of a day that nobody surveyed."""

    promise: SomeShare | None
    """The promise that a fix must keep to be adopted; None adopts every scan with a pose."""

    def __post_init__(self) -> None:
        check(self, "strategy")
