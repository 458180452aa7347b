"""Where each artifact lies: `artifacts/KIND/DATASET/…`, the file or folder of its last name.

The stages get their paths on the command line, from the dvc.yaml of each; whoever reads artifacts
of several stages asks a Layout.
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
    "altered": ("dataset", "view", "alteration", "sequence"),
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
"""The names below the folder of a kind, one folder each; the last one is the artifact's own."""
ENDINGS = {"train": MODEL, "events": ".csv", "latency": ".csv"}
"""How the artifact's own name goes on, if not .zarr."""
PLAIN = ("logs", "results", "report")
"""Kinds whose last name is whole as it is given."""


@dataclass(frozen=True)
class Layout:
    """The artifacts of all studies below one folder."""

    root: Path = Path(ARTIFACTS)

    def path(self, kind: str, *names: str) -> Path:
        """The path of an artifact, or of a folder where not all `names` of LEVELS are given.

        path("labels", "campus", "10m", "2012-01-15") is labels/campus/10m/2012-01-15.zarr below the
        root, path("labels", "campus") is labels/campus. Raises KeyError for a kind that LEVELS has
        not.
        """
        folder = self.root / kind
        if len(names) < len(LEVELS[kind]) or kind in PLAIN:
            return folder.joinpath(*names)
        *parents, name = names
        return folder.joinpath(*parents, f"{name}{ENDINGS.get(kind, '.zarr')}")

    def answers(self, dataset: str, grid: str, answers: ModelName, *sequence: str) -> Path:
        """Where a model's rankings, poses or paths lie: the folder, or those of one sequence."""
        if answers.path:
            return self.path("paths", dataset, grid, answers.name, *sequence)
        kind = "poses" if answers.posed else "localize"
        return self.path(kind, dataset, grid, replace(answers, posed=False).name, *sequence)
