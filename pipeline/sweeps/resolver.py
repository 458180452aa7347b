"""Finds or builds the artifacts of one job of a sweep: its settings in; paths of the artifacts out.

An artifact is taken from DVC where DVC built it with the same settings, or from an earlier job by
the key of its inputs, or else built. The steps of the chain are `chain`'s, what DVC built is known
by `lock`, and what jobs built lies in `cache`.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from pipeline.running.provenance import fingerprint
from pipeline.sweeps.cache import ArtifactCache
from pipeline.sweeps.chain import Step, code, inputs, producers
from pipeline.sweeps.lock import UpToDate, digest

Gather = Callable[[Mapping[str, str]], str]
"""Joins the replacements of several artifacts into one, for a field that names their common folder.

The replacements are given by the artifacts' paths within that folder."""


class StepSettings(NamedTuple):
    """The parameters that a step's result depends on."""

    values: Mapping[str, Any]
    follows_conf: bool
    """Whether all are those of the files in conf/."""


class ArtifactResolver:
    """Finds the artifacts of one job, or builds them.

    `from_dvc`, `from_sweeps` and `built` count by stage where they came from.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        lock: UpToDate,
        cache: ArtifactCache,
        settings: Callable[[Step], StepSettings],
        run: Callable[[Step, Mapping[str, str]], None],
    ) -> None:
        """`settings` gives a step's parameters in this job, `run` executes a step.

        `run` takes the step's paths and names on its command line as {field: value}.
        """
        self._producers = producers(steps)
        self._inputs = {step.command: inputs(step, self._producers) for step in steps}
        self._lock = lock
        self._cache = cache
        self._settings = settings
        self._run = run
        self._keys: dict[str, str] = {}
        self._paths: dict[str, Path] = {}
        self.from_dvc = Counter[str]()
        self.from_sweeps = Counter[str]()
        self.built = Counter[str]()

    def obtain(self, artifact: str) -> Path:
        """Where an artifact, named as in dvc.yaml, lies for this job; it is built if it must be."""
        if artifact not in self._paths:
            step = self._producers[artifact]
            self._paths |= dict(zip(step.outs, self._outputs(step), strict=True))
        return self._paths[artifact]

    def dvc_has(self, step: Step) -> bool:
        """Whether DVC has this step's artifacts just as this job wants them."""
        return (
            self._follows_conf(step)
            and self._lock.is_up_to_date(step, self._producers)
            and self._lock.is_intact(step)
        )

    def _follows_conf(self, step: Step) -> bool:
        """Whether this step and all before it have just the parameters of the files in conf/."""
        return self._settings(step).follows_conf and all(
            map(self._follows_conf, self._inputs[step.command].values())
        )

    def _outputs(self, step: Step) -> list[Path]:
        """The paths of a step's artifacts, in the order of `outs`."""
        if self.dvc_has(step):
            self.from_dvc[step.stage] += 1
            return [Path(out) for out in step.outs]
        names = _distinct_names(step.outs)

        def build(folder: Path) -> None:
            paths = {
                artifact: self.obtain(artifact).as_posix()
                for artifact in self._inputs[step.command]
            }
            for out, name in zip(step.outs, names, strict=True):
                paths[out] = (folder / name).as_posix()
            self._run(step, substituted_fields(step, paths, self._gathered_folder))

        folder, was_built = self._cache.get(step.stage, self._key(step), names, build)
        origin = self.built if was_built else self.from_sweeps
        origin[step.stage] += 1
        return [folder / name for name in names]

    def _gathered_folder(self, paths: Mapping[str, str]) -> str:
        return self._cache.gather(paths).as_posix()

    def _key(self, step: Step) -> str:
        """Digest of a step's parameters, code, and the keys of its inputs."""
        name = step.outs[0]
        if name not in self._keys:
            input_keys = {
                artifact: self._key(producer)
                for artifact, producer in self._inputs[step.command].items()
            }
            fields = substituted_fields(step, input_keys, _gathered_key)
            # Leave out the fields that name its own outputs.
            fields = {
                field: fields[field] for field in fields if step.fields[field] not in step.outs
            }
            sources = [(path.as_posix(), digest(path)) for path in code(step)]
            values = self._settings(step).values
            self._keys[name] = fingerprint(
                step.stage, json.dumps(values, sort_keys=True), sorted(fields.items()), sources
            )
        return self._keys[name]


def _gathered_key(keys: Mapping[str, str]) -> str:
    return fingerprint(sorted(keys.items()))


def substituted_fields(
    step: Step, replacements: Mapping[str, str], gather: Gather
) -> dict[str, str]:
    """A step's fields, each path to an artifact of `replacements` replaced.

    Replacements are paths where the step is to run, keys where it is to be fingerprinted.
    """
    return {
        field: _substituted(value, replacements, gather) for field, value in step.fields.items()
    }


def _substituted(value: str, replacements: Mapping[str, str], gather: Gather) -> str:
    """A field's value, replaced if it is the path to an artifact, to a part of one, or to a folder
    of several."""
    if not value:
        return value  # an empty path would be the parent of every artifact
    path = PurePosixPath(value)
    for artifact, replacement in replacements.items():
        if path.is_relative_to(artifact):
            return (PurePosixPath(replacement) / path.relative_to(artifact)).as_posix()
    parts = {
        PurePosixPath(artifact).relative_to(path).as_posix(): replacement
        for artifact, replacement in replacements.items()
        if PurePosixPath(artifact).is_relative_to(path)
    }
    folders = {replacement.removesuffix(f"/{name}") for name, replacement in parts.items()}
    if len(folders) == 1:
        return folders.pop()  # side by side already, as DVC leaves them
    return gather(parts) if parts else value


def _distinct_names(outs: Sequence[str]) -> list[str]:
    """A name for each artifact of one step.

    It is prefixed by the artifact's kind if an earlier one has the same name.
    """
    names: list[str] = []
    for path in map(PurePosixPath, outs):
        kind = path.parts[1]  # artifacts/KIND/…
        names.append(f"{kind}-{path.name}" if path.name in names else path.name)
    return names
