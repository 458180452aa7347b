"""Strategies: what to do with a model when a further day is to be learned (METHODS 11.4).

The model, the views that it learned and those of the new day go in; the next model comes out. The
last strategy, `SelfTrained`, is for sites that learn drives by themselves: it says which scans of a
drive they pseudo-label.
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
class Incremental:
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
        incremental: Model = replace(method, **self.settings).extend(
            model, learned_views, new_views, progress
        )
        return incremental


@dataclass(frozen=True)
@checked("strategy")
class SelfTrained:
    """Lets a site pseudo-label what it localises of a day without reference poses."""

    target_precision: SomeShare | None
    """The target precision at which a fix is pseudo-labelled; None pseudo-labels every scan with a
    pose."""
