"""Strategies: what becomes of a model when a further day was surveyed (METHODS 11.4)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.matching.ranking import Method, Model, TrainingSet
from pipeline.running.progress import Progress
from pipeline.running.settings import SomeShare, check


@dataclass(frozen=True)
class Frozen:
    """Nothing: the model stays as it was."""

    def learn(
        self, method: Method, model: Model, known: TrainingSet, new: TrainingSet, progress: Progress
    ) -> Model:
        """The model itself."""
        return model


@dataclass(frozen=True)
class Joint:
    """A new model of all days: what growth is measured by."""

    def learn(
        self, method: Method, model: Model, known: TrainingSet, new: TrainingSet, progress: Progress
    ) -> Model:
        """Learned from the beginning."""
        return method.learn(*TrainingSet.joined([known, new]), progress)


@dataclass(frozen=True)
class Grown:
    """The model learns the day besides what it knows."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    """Of the method, changed for growth."""

    def learn(
        self, method: Any, model: Model, known: TrainingSet, new: TrainingSet, progress: Progress
    ) -> Model:
        """The model of all days."""
        grown: Model = replace(method, **self.settings).grow(model, known, new, progress)
        return grown


@dataclass(frozen=True)
class Updated:
    """A site adopts what it localises of a day that nobody surveyed."""

    promise: SomeShare | None
    """That a fix must keep to be adopted; None adopts every scan with a pose."""

    def __post_init__(self) -> None:
        check(self, "strategy")
