"""Strategies: what to do with a model when a further day is to be learned (METHODS 11.4).

The model, the views that it learned and those of the new day go in; the next model comes out. The
last strategy, `Updated`, is for sites that learn drives by themselves: it says which scans of a
drive they adopt.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.core.progress import Progress
from pipeline.core.settings import SomeShare, checked
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
        """Return the model as it is."""
        return model


@dataclass(frozen=True)
class Joint:
    """Trains a new model on all days, which is the most that growth could reach."""

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
    """The settings of the method that are changed for growth."""

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
@checked("strategy")
class Updated:
    """Lets a site adopt what it localises of a day that nobody surveyed."""

    promise: SomeShare | None
    """The promise that a fix must keep to be adopted; None adopts every scan with a pose."""
