"""Strategies: how a model learns a further day (METHODS 11.4).

The model, the views that it learned and the views of the new day go in; the next model comes out.
The last strategy, `SelfTrained`, is for sites that learn drives without reference poses: it says
which scans of a drive they pseudo-label.
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
    """Trains a new model on all days: the upper bound of incremental learning."""

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
    """The settings of the method that differ for incremental learning."""

    def learn(
        self,
        method: Any,
        model: Model,
        learned_views: TrainingSet,
        new_views: TrainingSet,
        progress: Progress,
    ) -> Model:
        """Extend the model by the new views."""
        extended: Model = replace(method, **self.settings).extend(
            model, learned_views, new_views, progress
        )
        return extended


@dataclass(frozen=True)
@checked("strategy")
class SelfTrained:
    """Lets a site pseudo-label the scans of a day without reference poses by its own fixes."""

    target_precision: SomeShare | None
    """Scans are labelled by the fixes that are accepted at this target precision; with None, by
    every fix that has a pose."""
