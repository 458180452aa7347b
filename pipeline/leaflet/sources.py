"""Where the numbers of the page are from: each artifact, what dvc.lock recorded of it, and the recipe of each model."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Self

import yaml

from pipeline.leaflet.markup import Html, anchor, join, tag

UNKNOWN = "not in dvc.lock"


@dataclass(frozen=True)
class Lock:
    """What dvc.lock says of each artifact, by its path."""

    outs: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Path to md5 and the stage's name."""
    params: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Stage's name to its parameters, by file."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Empty where there is none, or none that can be read."""
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast, where it was built
        try:
            stages = (yaml.load(path.read_text(), loader) or {}).get("stages", {})
        except (OSError, yaml.YAMLError):
            return cls()
        outs = {out["path"]: (out.get("md5", ""), name) for name, stage in stages.items() for out in stage.get("outs", [])}
        return cls(outs, {name: stage.get("params", {}) for name, stage in stages.items()})

    def of(self, path: str) -> tuple[str, str]:
        """The md5 and the stage of an artifact or the folder around it; empty where it is unknown."""
        around = (path, *map(str, PurePosixPath(path).parents))
        return next((self.outs[one] for one in around if one in self.outs), ("", ""))


def disclosure(name: str, paths: Iterable[str], made_with: Mapping[str, Any]) -> Html:
    """A fold that lists artifacts, each a link into the appendix, and the parameters that numbers were made with."""
    listed = [tag("li", tag("a", tag("code", path), href=f"#{place(path)}")) for path in paths]
    parts = [tag("ul", *listed)] if listed else []
    if made_with:
        parts.append(definitions(made_with))
    return tag("details", tag("summary", "Source"), *parts, class_="source", id=name)


def definitions(told: Mapping[str, Any]) -> Html:
    """Names and values."""
    return tag("dl", *(tag("div", tag("dt", name), tag("dd", _value(value))) for name, value in told.items()))


def entry(path: str, lock: Lock, *more: Html) -> Html:
    """An artifact in the appendix: its path, md5 and stage."""
    md5, stage = lock.of(path)
    known = [" md5 ", tag("code", md5), " by ", _stage(stage)] if md5 else [" ", UNKNOWN]
    return tag("li", tag("code", path, class_="path"), tag("span", *known, class_="quiet"), *more, id=place(path))


def stages(names: Iterable[str], lock: Lock) -> Html:
    """The parameters that dvc.lock recorded of each stage."""
    folds = []
    for name in names:
        told = {file: params for file, params in lock.params.get(name, {}).items() if file != "conf/benchmark.yaml"}
        written = yaml.safe_dump(told, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)
        folds.append(tag("details", tag("summary", tag("code", name)), tag("pre", written), id=anchor("stage", name)))
    return join(folds)


def place(path: str) -> str:
    """The id of an artifact in the appendix."""
    return anchor("at", path)


def _stage(name: str) -> Html:
    return tag("a", tag("code", name), href=f"#{anchor('stage', name)}")


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_value(one)}" for name, one in value.items())
    if isinstance(value, str) or not isinstance(value, Iterable):
        return str(value)
    return ", ".join(map(_value, value))
