"""The frame of all stages: a file a stage, named like its DVC stage, its yaml in conf/ and the
folder of its artifacts.

A stage is a function of its settings, made a command by `stage`: Hydra composes its yaml with the
words of the command line, the settings are checked, the function reads artifacts, asks the library
and writes an artifact, and a line on it is printed. `each_sequence` serves those that write one
artifact a sequence.
"""

import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import wraps
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TypeVar, cast, get_type_hints

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as RichProgress

from pipeline.core.building import TARGET, target_class
from pipeline.core.errors import ConfigError, YearlocError, machine_refusal
from pipeline.core.progress import Progress
from pipeline.core.replacing import replace
from pipeline.core.settings import Names, filled
from pipeline.running.ending import end_when_asked
from pipeline.running.memory import keep_freed_memory
from pipeline.running.telemetry import Telemetry
from pipeline.running.texts import check_files, one_line, print_anywhere, read_yaml

Item = TypeVar("Item")
Settings = TypeVar("Settings")
"""The dataclass of a stage's settings."""
Prepare = Callable[[DictConfig, Sequence[str]], DictConfig]
"""Changes a composed configuration by the words of the command line."""
ROOT = Path(__file__).parents[1]
"""Of the project."""


@dataclass(frozen=True, kw_only=True)
class EachSequence:
    """The settings of a stage that writes an artifact of each sequence into a folder."""

    sequences: Names
    out: Path
    compute: DictConfig
    """How many at a time and where: a file of conf/compute, built where it is used."""


def _kernels() -> str:
    """A folder for numba's compiled kernels that follows from the library's source.

    numba itself looks only at the file of the outermost kernel, and would go on running an edited
    inner one as it was.
    """
    digest = sha256(
        b"".join(path.read_bytes() for path in sorted((ROOT / "pipeline").rglob("*.py")))
    )
    return str(ROOT / ".numba" / digest.hexdigest()[:16])


def _uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Ctrl-C while a stage is being loaded is a line too."""
    if issubclass(kind, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _uncaught
os.environ.setdefault("NUMBA_CACHE_DIR", _kernels())
os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # its errors reach `reported`
os.environ.setdefault(
    "OMP_WAIT_POLICY", "passive"
)  # read when torch is loaded: a waiting thread sleeps (benchmarks/waiting.py)
keep_freed_memory()
print_anywhere()
for talkative in (
    "aiobotocore",
    "botocore",
    "faiss",
):  # where keys were found; which instructions it was built for
    logging.getLogger(talkative).setLevel(logging.WARNING)


class Stage(Protocol):
    """What `stage` makes of a function."""

    run: Callable[[DictConfig], str]
    """The function with a configuration's settings, and telemetry.

    No Hydra, no line printed, errors as they are.
    """

    def __call__(self) -> None:
        """Main: compose conf/`name`.yaml with the command line, run, print the line."""


def stage(
    name: str, prepare: Prepare = lambda cfg, _: cfg
) -> Callable[[Callable[[Settings], str]], Stage]:
    """A stage's main: composes conf/`name`.yaml with the command line, runs, prints its line.

    The function takes one dataclass, the stage's settings; `filled` makes it of the composed
    configuration, which `prepare` may change by the words of the command line before. An error that
    this project raises on purpose becomes one line and exit code 1; any other keeps its traceback.
    """

    def decorate(function: Callable[[Settings], str]) -> Stage:
        (settings_class, _) = get_type_hints(function).values()

        @wraps(function)
        def run(cfg: DictConfig) -> str:
            for target in _targets(OmegaConf.to_container(cfg)):
                target_class(target, ("pipeline.",))
            settings = filled(settings_class, cfg, instantiate)
            with Telemetry(cfg.out) if cfg.get("out") else nullcontext():
                return function(settings)

        @wraps(function)
        def checked(cfg: DictConfig) -> None:
            with reported(name):
                print(f"{name}: {run(prepare(cfg, HydraConfig.get().overrides.task))}", flush=True)

        composed = hydra.main(version_base="1.3", config_path=str(ROOT / "conf"), config_name=name)(
            checked
        )

        @wraps(function)
        def main() -> None:
            end_when_asked()
            with reported(name):
                sys.argv[1:] = [*compute_words(name, sys.argv[1:]), *sys.argv[1:]]
                composed()

        decorated = cast(Stage, main)
        decorated.run = run
        return decorated

    return decorate


def each_sequence(
    settings: EachSequence,
    write: Callable[[str, Path], str],
    activity: str,
    one_by_one_in_threads: bool = False,
) -> str:
    """Write an artifact of each sequence into the folder `settings.out`; returns their lines.

    `write(sequence, folder)` writes one and returns its line; it may run in a process of its own.
    The folder is replaced once all are written. `one_by_one_in_threads` is as of Compute.
    """
    compute = instantiate(settings.compute)
    with (
        compute.one_by_one_in_threads() if one_by_one_in_threads else compute as started,
        replace(settings.out) as folder,
    ):
        folder.mkdir()
        sequences = settings.sequences
        lines = started.each(lambda sequence: write(sequence, folder), sequences)
        return "; ".join(ProgressBar().track(lines, len(sequences), activity))


@contextmanager
def reported(name: str) -> Iterator[None]:
    """Print an error that somebody can put right as one line, with exit code 1.

    Any other keeps its traceback.
    """
    try:
        yield
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        sys.exit(130)
    except Exception as error:
        if not (line := _line(error)):
            raise
        sys.exit(f"{name}: {one_line(line)}")


def _line(error: Exception) -> str:
    """The line of an error that somebody can put right; empty for a bug.

    A file of conf/ that cannot be read is such an error too.
    """
    cause = error.__cause__
    is_of_constructor = isinstance(error, InstantiationException)  # which Hydra wraps
    if is_of_constructor and isinstance(cause, YearlocError | TypeError):
        return str(cause)
    if line := str(error) if isinstance(error, YearlocError) else machine_refusal(error):
        return line
    try:
        check_files(ROOT / "conf")
    except ConfigError as broken:
        return str(broken)
    text = f"{str(error).partition('Config search path')[0]} {cause or ''}"
    is_of_configuration = isinstance(error, HydraException) and not is_of_constructor
    return " ".join(text.split()) if is_of_configuration else ""


def compute_words(name: str, overrides: Sequence[str]) -> list[str]:
    """The word `compute=…` that the environment's YEARLOC_COMPUTE adds to a stage's command line.

    None where the stage computes nothing in parallel, or the command line has its own. It is no
    part of the command in dvc.yaml, since no result depends on it.
    """
    scheduler = os.environ.get("YEARLOC_COMPUTE")
    defaults = read_yaml(ROOT / f"conf/{name}.yaml").get("defaults", ())
    has_compute = any("compute" in default for default in defaults)
    is_given = any(word.startswith("compute=") for word in overrides)
    return [f"compute={scheduler}"] if scheduler and has_compute and not is_given else []


def _targets(node: object) -> Iterator[str]:
    """The name of every class that a configuration would build."""
    if isinstance(node, dict | list):
        for child in node.values() if isinstance(node, dict) else node:
            yield from _targets(child)
    if isinstance(node, dict) and TARGET in node:
        yield str(node[TARGET])


def build(group: str, name: str, **changed_fields: Any) -> Any:
    """The object that a file of conf/ describes, with some of its fields changed."""
    return instantiate(OmegaConf.load(ROOT / "conf" / group / f"{name}.yaml"), **changed_fields)


def within_budget(cfg: DictConfig, overrides: Sequence[str]) -> DictConfig:
    """The configuration with what its budget, a file of conf/budget, says of its method.

    That is the share of its full training, and settings of the method; what `overrides` set stays
    as it is.
    """
    overridden = {override.lstrip("+").partition("=")[0] for override in overrides}
    method_module = cfg.method._target_.split(".")[-2]
    settings = {**cfg.budget.get(method_module, {})}
    share = settings.pop("share", cfg.budget.share)
    if "budget.share" in overridden:
        share = cfg.budget.share
    method = {key: value for key, value in settings.items() if f"method.{key}" not in overridden}
    return OmegaConf.create({**cfg, "method": {**cfg.method, **method}, "budget": {"share": share}})


@dataclass(frozen=True)
class ProgressBar(Progress):
    """A progress bar on a terminal; a line every tenth of the way where there is none."""

    numbers: dict[str, float] = field(default_factory=dict)

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(12),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with RichProgress(
            *columns, TextColumn("{task.fields[numbers]}"), console=console, transient=True
        ) as bar:
            task = bar.add_task(what, total=total, numbers="")
            for n_done, item in enumerate(items, start=1):
                yield item
                shown = "  ".join(
                    f"{name} {value:.3g}" for name, value in self.numbers.items() if name != "epoch"
                )
                bar.update(task, advance=1, numbers=shown)
                if (
                    self.numbers
                    and not console.is_terminal
                    and (n_done * 10 // total > (n_done - 1) * 10 // total or n_done == 1)
                ):
                    print(f"  {what} {n_done}/{total}: {shown}", file=sys.stderr, flush=True)

    def note(self, **numbers: float) -> None:
        self.numbers.clear()
        self.numbers.update(numbers)

    def tell(self, line: str) -> None:
        print(f"  {line}", file=sys.stderr, flush=True)
