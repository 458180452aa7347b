"""One job of a sweep: every artifact that it needs, taken from DVC, from an earlier job, or built."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.provenance import fingerprint
from pipeline.sweeps.chain import Step, code, inputs, producers
from pipeline.sweeps.ledger import Ledger, digest
from pipeline.sweeps.shelf import Shelf


@dataclass(frozen=True)
class Settings:
    """What a job gives to a step."""

    values: Mapping[str, Any]
    """All parameters that its result depends on."""
    usual: bool
    """They are those of the files in conf/."""


class Job:
    """Finds or builds artifacts; `reused` and `built` count them by stage.

    `settings` says what parameters a step gets; `run` runs it, given its paths and names as {field: value}.
    """

    def __init__(
        self,
        steps: Sequence[Step],
        ledger: Ledger,
        shelf: Shelf,
        settings: Callable[[Step], Settings],
        run: Callable[[Step, Mapping[str, str]], None],
    ) -> None:
        self._makers = producers(steps)
        self._ledger, self._shelf, self._settings, self._run = ledger, shelf, settings, run
        self._keys: dict[str, str] = {}
        self._found: dict[str, Path] = {}
        self.from_dvc: Counter[str] = Counter()
        self.from_sweeps: Counter[str] = Counter()
        self.built: Counter[str] = Counter()

    def path(self, artifact: str) -> Path:
        """Where an artifact, named as dvc.yaml does, lies for this job; it is built if it must be."""
        if artifact not in self._found:
            step = self._makers[artifact]
            self._found |= dict(zip(step.outs, self._obtain(step), strict=True))
        return self._found[artifact]

    def key(self, step: Step) -> str:
        """Digest of a step's parameters, code, and the keys of its inputs."""
        name = step.outs[0]
        if name not in self._keys:
            makers = inputs(step, self._makers)
            given = self._given(step, {artifact: self.key(maker) for artifact, maker in makers.items()})
            sources = [(path.as_posix(), digest(path)) for path in code(step)]
            values = json.dumps(self._settings(step).values, sort_keys=True)
            self._keys[name] = fingerprint(step.stage, values, sorted(given.items()), sources)
        return self._keys[name]

    def usual(self, step: Step) -> bool:
        """Whether neither this step nor any before it gets other parameters than those of the files in conf/."""
        return self._settings(step).usual and all(map(self.usual, inputs(step, self._makers).values()))

    def _obtain(self, step: Step) -> list[Path]:
        if self.usual(step) and self._ledger.vouches(step, self._makers) and self._ledger.intact(step):
            self.from_dvc[step.stage] += 1
            return [Path(out) for out in step.outs]
        names = [PurePosixPath(out).name for out in step.outs]

        def build(folder: Path) -> None:
            paths = {artifact: self.path(artifact).as_posix() for artifact in inputs(step, self._makers)}
            made = {out: (folder / name).as_posix() for out, name in zip(step.outs, names, strict=True)}
            self._run(step, self._given(step, paths | made))

        folder, built = self._shelf.get(step.stage, self.key(step), names, build)
        (self.built if built else self.from_sweeps)[step.stage] += 1
        return [folder / name for name in names]

    def _given(self, step: Step, stands_for: Mapping[str, str]) -> dict[str, str]:
        """A step's fields with something else in place of each artifact's path, or of the folder that it lies in."""
        folders = {
            str(PurePosixPath(artifact).parent): str(PurePosixPath(other).parent) for artifact, other in stands_for.items()
        }
        own = {**folders, **stands_for}
        return {field: own.get(value, value) for field, value in step.fields.items() if value not in step.outs or value in own}
