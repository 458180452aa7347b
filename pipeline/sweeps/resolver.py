"""Finds or builds the artifacts of one job of a sweep: its settings in; paths of the artifacts out.

1. If DVC built the artifact with the same settings, code and inputs, it is used (`lock`).
2. If an earlier job built it so, it is taken from the cache, by a key of all of these.
3. Else its inputs are found or built in the same way, and its step of the chain is run (`chain`).
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from filelock import FileLock

from pipeline.running.provenance import fingerprint
from pipeline.sweeps.chain import Step, code, inputs, producers
from pipeline.sweeps.lock import UpToDate, digest
from pipeline.sweeps.record import ORIGINS

Gather = Callable[[Mapping[str, str]], str]
"""Makes one replacement for a folder of several artifacts from the replacements of each.

They are given by the artifacts' paths within that folder.
"""


@dataclass(frozen=True)
class ArtifactCache:
    """A folder with an entry for each kind and key, such as `train/0f3c…/sci.zarr.zip`.

    Every file of an entry is written whole or not at all, so an entry is finished when all its
    files exist. A lock beside it makes a second job wait for the one that builds it. Entries may be
    deleted at any time; they are then built again.
    """

    root: Path
    """The cache's folder."""

    def get(
        self, kind: str, key: str, names: Sequence[str], build: Callable[[Path], None]
    ) -> tuple[Path, bool]:
        """The folder of an entry with the files `names`, and whether it was built just now.

        If a file is missing, `build(folder)` is called, which must write all of them.
        """
        folder = self.root / kind / key
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(".lock")):
            is_unfinished = not all((folder / name).exists() for name in names)
            if is_unfinished:
                build(folder)
        return folder, is_unfinished

    def gather(self, targets: Mapping[str, str]) -> Path:
        """Make a folder of symbolic links; `targets` has the path that each name in it leads to."""
        folder = self.root / "gathered" / fingerprint(sorted(targets.items()))
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in targets.items():
            with suppress(FileExistsError):  # another job may make the same folder
                (folder / name).symlink_to(Path(path).absolute())
        return folder


class StepSettings(NamedTuple):
    """The parameters that a step's result depends on, in one job."""

    values: Mapping[str, Any]
    follows_conf: bool
    """Whether all of them are as in the files of conf/, so that DVC may have built the step."""


class ArtifactResolver:
    """Finds the artifacts of one job, or builds them, and counts by stage where they came from."""

    def __init__(
        self,
        steps: Sequence[Step],
        lock: UpToDate,
        cache: ArtifactCache,
        settings: Callable[[Step], StepSettings],
        run: Callable[[Step, Mapping[str, str]], None],
    ) -> None:
        """`steps` are those of the whole chain, as the job wants it.

        `settings(step)` returns a step's parameters in this job. `run(step, fields)` executes a
        step with the values of its fields, the paths and names of its command line.
        """
        self._producers = producers(steps)
        self._inputs = {step.command: inputs(step, self._producers) for step in steps}
        self._lock = lock
        self._cache = cache
        self._settings = settings
        self._run = run
        self._keys: dict[str, str] = {}
        """The cache's key of each step, by the step's first artifact."""
        self._paths: dict[str, Path] = {}
        """Where each artifact that was found or built lies."""
        self.counts = {origin: Counter[str]() for origin in ORIGINS}
        """How many steps of each stage were found or run, by where the artifacts came from."""

    def obtain(self, artifact: str) -> Path:
        """Find an artifact, named as in dvc.yaml, or build it; returns where it lies."""
        if artifact not in self._paths:
            step = self._producers[artifact]
            self._paths |= dict(zip(step.outs, self._outputs(step), strict=True))
        return self._paths[artifact]

    def dvc_has(self, step: Step) -> bool:
        """Whether DVC built this step's artifacts exactly as this job wants them."""
        return (
            self._follows_conf(step)
            and self._lock.is_up_to_date(step, self._producers)
            and self._lock.is_intact(step)
        )

    def _follows_conf(self, step: Step) -> bool:
        """Whether this step and all steps before it have the parameters of the files in conf/."""
        return self._settings(step).follows_conf and all(
            map(self._follows_conf, self._inputs[step.command].values())
        )

    def _outputs(self, step: Step) -> list[Path]:
        """Find or build a step's artifacts; returns their paths in the order of `outs`."""
        if self.dvc_has(step):
            self.counts["from_dvc"][step.stage] += 1
            return [Path(out) for out in step.outs]
        names = _distinct_names(step.outs)

        def build(folder: Path) -> None:
            """Run the step, which writes its artifacts into an entry of the cache."""
            paths = {
                artifact: self.obtain(artifact).as_posix()
                for artifact in self._inputs[step.command]
            }
            for out, name in zip(step.outs, names, strict=True):
                paths[out] = (folder / name).as_posix()
            self._run(
                step,
                substituted_fields(step, paths, lambda parts: self._cache.gather(parts).as_posix()),
            )

        folder, was_built = self._cache.get(step.stage, self._key(step), names, build)
        self.counts["built" if was_built else "from_sweeps"][step.stage] += 1
        return [folder / name for name in names]

    def _key(self, step: Step) -> str:
        """The cache's key of a step: a digest of its parameters, code, and the inputs' keys."""
        name, *_ = step.outs
        if name not in self._keys:
            input_keys = {
                artifact: self._key(producer)
                for artifact, producer in self._inputs[step.command].items()
            }
            fields = substituted_fields(
                step, input_keys, lambda keys: fingerprint(sorted(keys.items()))
            )
            fields_without_outputs = {
                field: value
                for field, value in fields.items()
                if step.fields[field] not in step.outs
            }
            sources = [(path.as_posix(), digest(path)) for path in code(step)]
            values = self._settings(step).values
            self._keys[name] = fingerprint(
                step.stage,
                json.dumps(values, sort_keys=True),
                sorted(fields_without_outputs.items()),
                sources,
            )
        return self._keys[name]


def substituted_fields(
    step: Step, replacements: Mapping[str, str], gather: Gather
) -> dict[str, str]:
    """A step's fields, in which each path to an artifact is replaced.

    `replacements` has for each artifact its path in this job, if the step is to run, or its key, if
    a key of the step is computed.
    """
    return {
        field: _substituted(value, replacements, gather) for field, value in step.fields.items()
    }


def _substituted(value: str, replacements: Mapping[str, str], gather: Gather) -> str:
    """A field's value, replaced if it is the path of an artifact, of its part, or of its folder."""
    if not value:
        return value  # an empty path would be the parent of every artifact
    path = PurePosixPath(value)
    # an artifact, or a part of one
    for artifact, replacement in replacements.items():
        if path.is_relative_to(artifact):
            return (PurePosixPath(replacement) / path.relative_to(artifact)).as_posix()
    # a folder of several artifacts, by their paths within it
    parts = {
        PurePosixPath(artifact).relative_to(path).as_posix(): replacement
        for artifact, replacement in replacements.items()
        if PurePosixPath(artifact).is_relative_to(path)
    }
    if not parts:
        return value  # no path, but a name or a number
    folders = {replacement.removesuffix(f"/{name}") for name, replacement in parts.items()}
    if len(folders) == 1:
        return folders.pop()  # they lie in one folder already, as DVC leaves them
    return gather(parts)


def _distinct_names(outs: Sequence[str]) -> list[str]:
    """A file name for each artifact of one step; a repeated name gets its kind as a prefix."""
    names: list[str] = []
    for path in map(PurePosixPath, outs):
        kind = path.parts[1]  # artifacts/KIND/…
        names.append(f"{kind}-{path.name}" if path.name in names else path.name)
    return names
