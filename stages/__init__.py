"""Stage entry points: one file a stage, named like its DVC stage, its conf file and its artifact's
folder."""

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
from typing import Annotated, Any, Protocol, TypeVar, cast

import hydra
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

from pipeline.errors import ConfigError, YearlocError, refusal
from pipeline.running.building import TARGET, target_class
from pipeline.running.ending import end_when_asked
from pipeline.running.memory import keep_freed_memory
from pipeline.running.progress import Progress
from pipeline.running.settings import Count, NotNegative, Positive, Range, Share, within
from pipeline.running.telemetry import Telemetry
from pipeline.running.texts import check_files, one_line, print_anywhere, read_yaml

Item = TypeVar("Item")
ROOT = Path(__file__).parents[1]
ABSENT = object()
OPTIONAL = ("root", "altered", "alterations", "from")
"""Of the settings that are null in a stage's file, those that may stay so."""
NUMBERS = {"every_m": NotNegative, "grid.cell_m": Annotated[float, Range(0.1, 10_000)]}
NUMBERS |= dict.fromkeys(("k", "few", "queries"), Count)
NUMBERS |= dict.fromkeys(("grain_m", "voxel_m", "range_m", "gathered_m", "budget.share"), Positive)
NUMBERS |= dict.fromkeys(("unseen_share", "wanted_precision"), Share)
"""What the numbers may be that stand in a stage's own file, and fill no dataclass."""


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
    """The function itself, with telemetry: no Hydra, no line printed, errors as they are."""

    def __call__(self) -> None:
        """Main: compose conf/`name`.yaml with the command line, run, print the line."""


def stage(name: str) -> Callable[[Callable[[DictConfig], str]], Stage]:
    """A stage's main: composes conf/`name`.yaml with the command line, runs, prints its line.

    An error that this project raises on purpose becomes one line and exit code 1; any other keeps
    its traceback.
    """

    def decorate(function: Callable[[DictConfig], str]) -> Stage:
        @wraps(function)
        def run(cfg: DictConfig) -> str:
            _check(cfg)
            with Telemetry(cfg.out) if cfg.get("out") else nullcontext():
                return function(cfg)

        @wraps(function)
        def checked(cfg: DictConfig) -> None:
            with reported(name):
                if missing := [
                    str(key) for key, value in cfg.items() if value is None and key not in OPTIONAL
                ]:
                    raise ConfigError(
                        f"not given: {', '.join(missing)}; `dvc repro` gives what a stage needs"
                    )
                print(f"{name}: {run(cfg)}", flush=True)

        composed = hydra.main(version_base="1.3", config_path=str(ROOT / "conf"), config_name=name)(
            checked
        )

        @wraps(function)
        def main() -> None:
            end_when_asked()
            with reported(name):
                sys.argv[1:] = [*_elsewhere(name, sys.argv[1:]), *sys.argv[1:]]
                composed()

        decorated = cast(Stage, main)
        decorated.run = run
        return decorated

    return decorate


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
    built = isinstance(error, InstantiationException)
    if built and isinstance(
        cause, YearlocError | TypeError
    ):  # Hydra wraps what a constructor raised
        return str(cause)
    if line := str(error) if isinstance(error, YearlocError) else refusal(error):
        return line
    try:
        check_files(ROOT / "conf")
    except ConfigError as broken:
        return str(broken)
    text = f"{str(error).partition('Config search path')[0]} {cause or ''}"
    return " ".join(text.split()) if isinstance(error, HydraException) and not built else ""


def _check(cfg: DictConfig) -> None:
    """Raise ConfigError for a number out of its range, or a class of another project."""
    for target in _targets(OmegaConf.to_container(cfg)):
        target_class(target, ("pipeline.",))
    for setting, hint in NUMBERS.items():
        if (number := OmegaConf.select(cfg, setting, default=ABSENT)) is not ABSENT:
            within(setting, number, hint)


def _elsewhere(name: str, overrides: Sequence[str]) -> list[str]:
    """The override `compute=` of the environment's YEARLOC_COMPUTE, if the stage has it.

    No result and so no cache depends on it; a command's own wins.
    """
    scheduler = os.environ.get("YEARLOC_COMPUTE")
    defaults = read_yaml(ROOT / f"conf/{name}.yaml").get("defaults", ())
    asks = any("compute" in default for default in defaults)
    return (
        [f"compute={scheduler}"]
        if scheduler and asks and not any(word.startswith("compute=") for word in overrides)
        else []
    )


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
    """The configuration with conf/budget's settings of its method in `method` and `budget`.

    What `overrides` set stays as it is.
    """
    explicit = {override.lstrip("+").partition("=")[0] for override in overrides}
    words = {"share": cfg.budget.share, **cfg.budget.get(cfg.method._target_.split(".")[-2], {})}
    share = cfg.budget.share if "budget.share" in explicit else words["share"]
    budgeted = {
        key: value
        for key, value in words.items()
        if key != "share" and f"method.{key}" not in explicit
    }
    return OmegaConf.create(
        {**cfg, "method": {**cfg.method, **budgeted}, "budget": {"share": share}}
    )


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
