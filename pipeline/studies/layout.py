"""Says where each artifact lies: a kind and names in; the path artifacts/KIND/DATASET/… out.

A stage gets its paths on the command line, from its dvc.yaml. Whatever reads the artifacts of
several stages, such as the report, asks a `Layout`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.core.store import MODEL
from pipeline.studies.models import ModelName

ARTIFACTS = "artifacts"
"""The project's folder of artifacts."""
LEVELS = {
    "logs": ("dataset", "sequence"),
    "slam": ("dataset", "sequence"),
    "scans": ("dataset", "sequence"),
    "submaps": ("dataset", "sequence"),
    "views": ("dataset", "view", "sequence"),
    "perturbed": ("dataset", "view", "perturbation", "sequence"),
    "labels": ("dataset", "grid", "sequence"),
    "train": ("dataset", "grid", "model"),
    "localize": ("dataset", "grid", "model", "sequence"),
    "map": ("dataset", "sequence"),
    "poses": ("dataset", "grid", "model", "sequence"),
    "paths": ("dataset", "grid", "model", "sequence"),
    "evaluate": ("dataset", "grid", "model", "sequence"),
    "viewpoints": ("dataset", "grid", "model", "sequence"),
    "events": ("dataset", "sequence"),
    "lifelong": ("dataset", "grid", "model", "course"),
    "latency": ("dataset", "grid"),
    "results": ("dataset", "file"),
    "report": ("dataset", "grid", "file"),
}
"""What the names of each kind's artifacts stand for; all but the last are folders."""
ENDINGS = {"train": MODEL, "events": ".csv", "latency": ".csv"}
"""The ending of an artifact's file or folder, for kinds where it is not .zarr."""
PLAIN = ("logs", "results", "report")
"""Kinds whose artifacts get no ending: their last name is given with its own."""


@dataclass(frozen=True)
class Layout:
    """The artifacts of all studies below one folder."""

    root: Path = Path(ARTIFACTS)

    def path(self, kind: str, *names: str) -> Path:
        """The path of an artifact, or of a folder where not all `names` of LEVELS are given.

        path("labels", "campus", "10m", "2012-01-15") is labels/campus/10m/2012-01-15.zarr below the
        root, and path("labels", "campus") is labels/campus. Raises KeyError for a kind that is not
        in LEVELS.
        """
        folder = self.root / kind
        if len(names) < len(LEVELS[kind]) or kind in PLAIN:
            return folder.joinpath(*names)
        *parents, name = names
        return folder.joinpath(*parents, f"{name}{ENDINGS.get(kind, '.zarr')}")

    def answers(self, dataset: str, grid: str, model: ModelName, *sequence: str) -> Path:
        """The folder of a model's rankings, poses or paths, or the artifact of one sequence.

        Which of the three they are, the name says: it has a path, or is posed, or neither.
        """
        if model.path:
            return self.path("paths", dataset, grid, model.name, *sequence)
        kind = "poses" if model.posed else "localize"
        # poses have a folder of their own, so the name in it need not say that they are poses
        return self.path(kind, dataset, grid, replace(model, posed=False).name, *sequence)
