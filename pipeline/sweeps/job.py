"""One job of a sweep: takes each artifact from DVC or from an earlier job, or builds it."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from pipeline.running.provenance import fingerprint
from pipeline.sweeps.cache import ArtifactCache
from pipeline.sweeps.chain import Step, code, inputs, producers
from pipeline.sweeps.lock import UpToDate, digest


class StepSettings(NamedTuple):
    """The parameters that a step's result depends on."""

    values: Mapping[str, Any]
    follows_conf: bool
    """Whether all are those of the files in conf/."""


class ArtifactResolver:
    """Finds the artifacts of one job, or builds them.

    `from_dvc`, `from_sweeps` and `built` count them by stage. `settings` gives the parameters that
    a step's result depends on; `run` executes the step with its paths and names as {field: value}.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        lock: UpToDate,
        cache: ArtifactCache,
        settings: Callable[[Step], StepSettings],
        run: Callable[[Step, Mapping[str, str]], None],
    ) -> None:
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
            self._paths |= dict(zip(step.outs, self._found_or_built(step), strict=True))
        return self._paths[artifact]

    def key(self, step: Step) -> str:
        """Digest of a step's parameters, code, and the keys of its inputs."""
        name = step.outs[0]
        if name not in self._keys:
            keys = {
                artifact: self.key(producer)
                for artifact, producer in self._inputs[step.command].items()
            }
            fields = self._substituted_fields(
                step, keys, lambda parts: fingerprint(sorted(parts.items()))
            )
            sources = [(path.as_posix(), digest(path)) for path in code(step)]
            values = self._settings(step).values
            self._keys[name] = fingerprint(
                step.stage, json.dumps(values, sort_keys=True), sorted(fields.items()), sources
            )
        return self._keys[name]

    def follows_conf(self, step: Step) -> bool:
        """Whether this step and all before it have just the parameters of the files in conf/."""
        return self._settings(step).follows_conf and all(
            map(self.follows_conf, self._inputs[step.command].values())
        )

    def dvc_has(self, step: Step) -> bool:
        """Whether DVC has this step's artifacts just as this job wants them."""
        return (
            self.follows_conf(step)
            and self._lock.vouches(step, self._producers)
            and self._lock.intact(step)
        )

    def _found_or_built(self, step: Step) -> list[Path]:
        if self.dvc_has(step):
            self.from_dvc[step.stage] += 1
            return [Path(out) for out in step.outs]
        names = distinct_names(step.outs)

        def build(folder: Path) -> None:
            paths = {
                artifact: self.obtain(artifact).as_posix()
                for artifact in self._inputs[step.command]
            }
            written = {
                out: (folder / name).as_posix() for out, name in zip(step.outs, names, strict=True)
            }
            self._run(
                step,
                self._substituted_fields(
                    step, paths | written, lambda parts: self._cache.gather(parts).as_posix()
                ),
            )

        folder, built = self._cache.get(step.stage, self.key(step), names, build)
        (self.built if built else self.from_sweeps)[step.stage] += 1
        return [folder / name for name in names]

    def _substituted_fields(
        self,
        step: Step,
        replacements: Mapping[str, str],
        gather: Callable[[Mapping[str, str]], str],
    ) -> dict[str, str]:
        """A step's fields with each path to an artifact substituted.

        By another path to run the step, by a key to fingerprint it.

        A path may also lead to a part of an artifact, or to a folder of several, which `gather`
        makes one. Artifacts that the step makes are left out of its key: they are not there yet.
        """

        def replaced(value: str) -> str:
            if not value:
                return value  # no path: as one it would hold every artifact
            path = PurePosixPath(value)
            for artifact, replacement in replacements.items():
                if path.is_relative_to(artifact):
                    return (PurePosixPath(replacement) / path.relative_to(artifact)).as_posix()
            inside = {
                artifact: replacement
                for artifact, replacement in replacements.items()
                if PurePosixPath(artifact).is_relative_to(path)
            }
            parts = {
                PurePosixPath(artifact).relative_to(path).as_posix(): replacement
                for artifact, replacement in inside.items()
            }
            folders = {replacement.removesuffix(f"/{name}") for name, replacement in parts.items()}
            if len(folders) == 1:
                return folders.pop()  # side by side already, as DVC leaves them
            return gather(parts) if parts else value

        return {
            field: replaced(value)
            for field, value in step.fields.items()
            if value not in step.outs or value in replacements
        }


def distinct_names(outs: Sequence[str]) -> list[str]:
    """A name for each artifact of one step, with its kind before it where two have one name."""
    names: list[str] = []
    for path in map(PurePosixPath, outs):
        # artifacts/KIND/…
        names.append(f"{path.parts[1]}-{path.name}" if path.name in names else path.name)
    return names
