"""The decorator that makes a command of a stage's function, and helpers that all stages share.

A stage is one step of the chain that DVC runs, from raw logs to the report. Each stage has a file
here; the file, the DVC stage, its yaml in conf/ and the folder of its artifacts have the same name.
The stage's function takes the settings, reads artifacts, calls the library, writes an artifact and
returns a one-line summary.

`python -m stages.NAME KEY=VALUE …` runs a stage: Hydra composes its yaml with the overrides on the
command line, the settings are checked, the function runs, and its summary is printed.
"""

import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from pipeline.running.process import end_when_asked, keep_freed_memory
from pipeline.running.telemetry import Telemetry
from pipeline.running.texts import check_files, one_line, print_anywhere, read_yaml

Item = TypeVar("Item")
Settings = TypeVar("Settings")
"""The dataclass of a stage's settings."""
Prepare = Callable[[DictConfig, Sequence[str]], DictConfig]
"""Takes a composed configuration and the overrides on the command line; returns the configuration
to use."""
ROOT = Path(__file__).parents[1]
"""The project's folder."""
METHODS = ("pipeline.methods.",)
"""The package of all methods' classes; a model's recipe may name no class outside of it."""


@dataclass(frozen=True, kw_only=True)
class EachSequence:
    """The settings of a stage that writes one artifact for each sequence into a folder."""

    sequences: Names
    out: Path
    """Folder for the artifacts."""
    compute: DictConfig
    """How many sequences are processed at a time, and by which workers: a file of conf/compute."""


def _kernel_folder() -> str:
    """A folder for numba's compiled kernels; its name is a digest of our source code."""
    # numba checks only the file of the outermost kernel for changes, not those of inner kernels
    folders = (ROOT / "pipeline", ROOT / "worlds")
    sources = [path.read_bytes() for root in folders for path in sorted(root.rglob("*.py"))]
    return str(ROOT / ".numba" / sha256(b"".join(sources)).hexdigest()[:16])


def _on_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print one line for a Ctrl-C while a stage is still being imported, not a traceback."""
    if issubclass(kind, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _prepare_process() -> None:
    """Set up the process of a stage, before its file imports the libraries that read this setup."""
    sys.excepthook = _on_uncaught
    os.environ.setdefault("NUMBA_CACHE_DIR", _kernel_folder())
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra's errors reach `reported`
    # torch's waiting threads sleep instead of spinning (benchmarks/waiting.py)
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    keep_freed_memory()
    print_anywhere()
    # these libraries log where credentials were found, and which instructions they were built for
    for library in ("aiobotocore", "botocore", "faiss"):
        logging.getLogger(library).setLevel(logging.WARNING)


_prepare_process()


class Stage(Protocol):
    """A stage's function as the decorator `stage` returns it."""

    run: Callable[[DictConfig], str]
    """Runs the function with the settings of a configuration, and records telemetry.

    It does not compose a configuration, prints nothing, and raises errors as they are.
    """

    def __call__(self) -> None:
        """Run the stage as a command: compose its configuration, run the function, print."""


def stage(
    name: str, prepare: Prepare = lambda cfg, _: cfg
) -> Callable[[Callable[[Settings], str]], Stage]:
    """Decorate the function of the stage `name`: its command composes settings, runs, and prints.

    1. Hydra composes conf/`name`.yaml with the overrides on the command line.
    2. `prepare` may change the configuration, given these overrides.
    3. `filled` checks it and fills the function's only argument, a dataclass of settings.
    4. The function runs, and the line that it returns is printed.

    An error that this project raises on purpose becomes one line and exit code 1. Any other error
    keeps its traceback.
    """

    def decorate(function: Callable[[Settings], str]) -> Stage:
        settings_class, _ = get_type_hints(function).values()  # of the argument, and of the result

        @wraps(function)
        def run(cfg: DictConfig) -> str:
            for target in _targets(OmegaConf.to_container(cfg)):
                target_class(target, ("pipeline.", "worlds."))
            advice = "; `dvc repro` gives what a stage needs"
            settings = filled(settings_class, cfg, _built, advice=advice)
            with Telemetry(cfg.out) if cfg.get("out") else nullcontext():
                return function(settings)

        @wraps(function)
        def run_and_print(cfg: DictConfig) -> None:
            with reported(name):
                line = run(prepare(cfg, HydraConfig.get().overrides.task))
                print(f"{name}: {line}", flush=True)

        compose_and_run = hydra.main(
            version_base="1.3", config_path=str(ROOT / "conf"), config_name=name
        )(run_and_print)

        @wraps(function)
        def main() -> None:
            end_when_asked()
            with reported(name):
                sys.argv[1:] = [*compute_words(name, sys.argv[1:]), *sys.argv[1:]]
                compose_and_run()

        command = cast(Stage, main)
        command.run = run
        return command

    return decorate


def _built(_: Any, setting: Any) -> Any:
    """The object that a table with the key `_target_` describes; any other setting unchanged."""
    is_recipe = isinstance(setting, Mapping) and TARGET in setting
    return instantiate(setting) if is_recipe else setting


def each_sequence(
    settings: EachSequence,
    write: Callable[[str, Path], str],
    activity: str,
    one_by_one_in_threads: bool = False,
) -> str:
    """Write an artifact of each sequence into the folder `settings.out`; returns their summaries.

    `write(sequence, folder)` writes one artifact and returns a one-line summary; it may run in a
    process of its own. The folder is moved into place once all artifacts are written. `activity`
    names the work in the progress bar. With `one_by_one_in_threads` the method of `Compute` of this
    name is used, for work with torch.
    """
    compute = instantiate(settings.compute)
    if one_by_one_in_threads:
        compute = compute.one_by_one_in_threads()
    with compute as started, replace(settings.out) as folder:
        folder.mkdir()
        sequences = settings.sequences
        lines = started.each(lambda sequence: write(sequence, folder), sequences)
        return "; ".join(ProgressBar().track(lines, len(sequences), activity))


@contextmanager
def reported(name: str) -> Iterator[None]:
    """Turn an error of the block that a user can correct into one line and exit code 1.

    Any other error keeps its traceback.
    """
    try:
        yield
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        sys.exit(130)
    except Exception as error:
        if not (line := _explanation(error)):
            raise
        sys.exit(f"{name}: {one_line(line)}")


def _explanation(error: Exception) -> str:
    """One line on an error that a user can correct; empty for a bug."""
    cause = error.__cause__
    # Hydra wraps errors that are raised while it instantiates a class
    is_of_constructor = isinstance(error, InstantiationException)
    if is_of_constructor and isinstance(cause, YearlocError | TypeError):
        return str(cause)
    if isinstance(error, YearlocError):
        return str(error)
    if refusal := machine_refusal(error):
        return refusal
    # any other error may be due to an unreadable file in conf/
    try:
        check_files(ROOT / "conf")
    except ConfigError as broken_file:
        return str(broken_file)
    if isinstance(error, HydraException) and not is_of_constructor:
        text = f"{str(error).partition('Config search path')[0]} {cause or ''}"
        return " ".join(text.split())
    return ""


def compute_words(name: str, overrides: Sequence[str]) -> list[str]:
    """The overrides that the environment variable YEARLOC_COMPUTE adds to a stage's command line.

    There is one override, `compute=…`, or none if the stage computes nothing in parallel or the
    command line has this override already. The command in dvc.yaml has none, since no result
    depends on it.
    """
    scheduler = os.environ.get("YEARLOC_COMPUTE")
    defaults = read_yaml(ROOT / f"conf/{name}.yaml").get("defaults", ())
    has_compute = any("compute" in default for default in defaults)
    is_given = any(word.startswith("compute=") for word in overrides)
    return [f"compute={scheduler}"] if scheduler and has_compute and not is_given else []


def _targets(node: object) -> Iterator[str]:
    """The name of every class that a configuration would instantiate."""
    if isinstance(node, dict | list):
        for child in node.values() if isinstance(node, dict) else node:
            yield from _targets(child)
    if isinstance(node, dict) and TARGET in node:
        yield str(node[TARGET])


def build(group: str, name: str, **changed_fields: Any) -> Any:
    """Instantiate the object of conf/`group`/`name`.yaml, with some of its fields changed."""
    return instantiate(OmegaConf.load(ROOT / "conf" / group / f"{name}.yaml"), **changed_fields)


def within_budget(cfg: DictConfig, overrides: Sequence[str]) -> DictConfig:
    """The configuration of a training, with its method's settings changed by the budget.

    A budget, a file of conf/budget, has the share of a method's full training to run, and may have
    a table of settings for a method. Settings in `overrides`, those on the command line, are kept.
    """
    overridden_keys = {override.lstrip("+").partition("=")[0] for override in overrides}
    method_module = cfg.method._target_.split(".")[-2]
    settings = {**cfg.budget.get(method_module, {})}
    share = settings.pop("share", cfg.budget.share)
    if "budget.share" in overridden_keys:
        share = cfg.budget.share
    changed_settings = {
        key: value for key, value in settings.items() if f"method.{key}" not in overridden_keys
    }
    method = {**cfg.method, **changed_settings}
    return OmegaConf.create({**cfg, "method": method, "budget": {"share": share}})


@dataclass(frozen=True)
class ProgressBar(Progress):
    """A bar on a terminal; elsewhere a line after every tenth of the work, if there are numbers."""

    numbers: dict[str, float] = field(default_factory=dict)
    """The latest numbers, such as a loss; they are shown beside the bar."""

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
                numbers = self._numbers_text()
                bar.update(task, advance=1, numbers=numbers)
                ends_a_tenth = n_done * 10 // total > (n_done - 1) * 10 // total
                if self.numbers and not console.is_terminal and (ends_a_tenth or n_done == 1):
                    print(f"  {what} {n_done}/{total}: {numbers}", file=sys.stderr, flush=True)

    def _numbers_text(self) -> str:
        """The numbers without the epoch, which the bar itself counts."""
        numbers = [f"{name} {value:.3g}" for name, value in self.numbers.items() if name != "epoch"]
        return "  ".join(numbers)

    def note(self, **numbers: float) -> None:
        self.numbers.clear()
        self.numbers.update(numbers)

    def tell(self, line: str) -> None:
        print(f"  {line}", file=sys.stderr, flush=True)
