"""The `yearloc` command."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import psutil
import yaml

from pipeline.errors import ConfigError, YearlocError

ABOUT = """\
Learn a place from LiDAR on one day, localise in it for a year.

The work itself is a chain of stages that DVC runs: `dvc repro` builds whatever is out of date, from raw logs to a report.
This command chooses what the chain runs on, and looks at what it made.

  yearloc use campus                         the simulated campus (no data needed); world=tiny|demo|year
  yearloc use nclt root=/data/nclt           NCLT as its archives unpack; train=DATE tests=DATE,DATE
  yearloc use kitti root=/data/kitti log=00  KITTI odometry: the first part of one log against the rest
  yearloc inspect artifacts/scans/campus/2012-01-15.zarr
  yearloc inspect 1326652795280148.bin --format nclt
  yearloc results                            the table, and where the figures are
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse, run, and turn an error that this project raises on purpose into one line and exit code 1."""
    parser = argparse.ArgumentParser("yearloc", description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    use = commands.add_parser("use", help="choose a data set: check what is on disk and write conf/benchmark.yaml")
    use.add_argument("dataset", nargs="?", help="campus, nclt or kitti: a file in conf/dataset; without it, print the one in use")
    use.add_argument("options", nargs="*", metavar="KEY=VALUE", help="root, log, train, tests, world, budget")
    use.add_argument("--keep", action="store_true", help="leave a list of this data set and world as it is, additions and all")
    look = commands.add_parser("inspect", help="say what a file or artifact is: ranges, counts, frames, provenance, warnings")
    look.add_argument("path", type=Path, metavar="FILE-OR-ARTIFACT")
    look.add_argument("--format", choices=("nclt", "kitti"), help="whose .bin file it is, where its folder does not tell")
    commands.add_parser("results", help="print the results of the last report and where its figures are")
    commands.add_parser("repair", help="put right what a kill may leave of DVC's own files; `make demo` does it first")
    given = parser.parse_args(arguments)
    try:
        {"use": _use, "inspect": _inspect, "results": _results, "repair": _repair}[given.command](given)
    except YearlocError as error:
        print(f"yearloc {given.command}: {error}", file=sys.stderr)
        sys.exit(1)


def _use(given: argparse.Namespace) -> None:
    from pipeline.benchmark import propose

    conf = _conf()
    if given.dataset is None:
        print(_names(conf / "benchmark.yaml")["dataset"])
        return
    pairs = [option.partition("=") for option in given.options]
    if odd := [key for key, sign, _ in pairs if not sign]:
        raise ConfigError(f"{odd[0]}: options are written KEY=VALUE")
    proposal = propose(conf, given.dataset, {key: value for key, _, value in pairs})
    path = conf / "benchmark.yaml"
    present = _names(path) if path.is_file() else {}
    kept = given.keep and all(present.get(key) == proposal.names[key] for key in ("dataset", "world"))
    if not kept and (not path.is_file() or path.read_text() != proposal.text()):
        path.write_text(proposal.text())
    names = present if kept else proposal.names
    for note in proposal.notes:
        print(f"  {note}")
    print(f"conf/benchmark.yaml: {names['dataset']}, trained on {names['train']}, tested on {', '.join(names['tests'])}")


def _inspect(given: argparse.Namespace) -> None:
    from pipeline.inspection.report import inspect

    print(inspect(given.path, given.format).text())


def _results(given: argparse.Namespace) -> None:
    names = _names(_conf() / "benchmark.yaml")
    for grid in names["grids"]:
        folder = Path("artifacts/report", names["dataset"], grid)
        if not (folder / "results.txt").is_file():
            raise ConfigError(f"{folder}: no report yet; run `dvc repro`")
        print((folder / "results.txt").read_text())
        for path in [folder / "report.md", *sorted(folder.glob("*.svg"))]:
            print(f"  {path}")
    print("\ndashboard: make dashboard")


def _repair(given: argparse.Namespace) -> None:
    """DVC writes two files in place, so a kill at the wrong moment leaves a torn one; both can be had again.

    Without dvc.lock, DVC finds finished stages in its run cache. The table of locks is of no use once its holders are dead.
    """
    lock, table = Path("dvc.lock"), Path(".dvc/tmp/rwlock")
    if lock.is_file() and not isinstance(_parsed(lock, yaml.safe_load), dict):
        lock.unlink()
        print("dvc.lock: was torn by a kill, removed; what is finished comes back from DVC's cache")
    if table.is_file() and not any(map(_alive, _holders(_parsed(table, json.loads)))):
        table.unlink()


def _parsed(path: Path, parse: Callable[[str], Any]) -> Any:
    try:
        return parse(path.read_text())
    except (ValueError, yaml.YAMLError):
        return None


def _holders(node: Any) -> list[int]:
    """Every pid in DVC's table of locks."""
    if isinstance(node, list):
        return [pid for item in node for pid in _holders(item)]
    if isinstance(node, dict):
        return [node["pid"]] if isinstance(node.get("pid"), int) else _holders(list(node.values()))
    return []


def _alive(pid: int) -> bool:
    """Whether a process runs; a killed one that nobody has waited for yet does not."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def _conf() -> Path:
    """The project's conf folder; the command is meant to be called from the project's root."""
    conf = Path("conf")
    if not (conf / "dataset").is_dir():
        raise ConfigError("call this in the project's root folder, where conf/ is")
    return conf


def _names(path: Path) -> dict[str, Any]:
    names: dict[str, Any] = yaml.safe_load(path.read_text())["benchmark"]
    return names
