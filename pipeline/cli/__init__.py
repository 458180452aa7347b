"""The `yearloc` command."""

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.cli import grow, picture, repro, results, site
from pipeline.cli.failures import failures
from pipeline.cli.localize import localize
from pipeline.cli.progress import Bytes
from pipeline.cli.project import conf_folder, read_studies, refuse_code_of_another
from pipeline.errors import ConfigError, YearlocError, refusal
from pipeline.replacing import replace
from pipeline.running.ending import end_when_asked
from pipeline.running.memory import keep_freed_memory
from pipeline.running.texts import (
    WRITTEN,
    check_files,
    one_line,
    print_anywhere,
    read_yaml,
    terminal_width,
)

if TYPE_CHECKING:
    from pipeline.readers.folder import Folder

ABOUT = """\
Learn a place from LiDAR on one day, localise in it for a year.

The work itself is a chain of stages that DVC runs: `dvc repro` builds whatever is out of date,
from raw logs to a report. This command chooses what the chain runs on, and looks at what it made.

  yearloc use campus town                    simulated campus and town (no data needed)
  yearloc use nclt root=/data/nclt           NCLT as its archives unpack; train=DATE tests=DATE,DATE
  yearloc use robotcar root=/data/robotcar   Oxford RobotCar: 2-D sweeps gathered along the odometry
  yearloc use kitti root=/data/kitti log=00  KITTI odometry: the first part of a log, then the rest
  yearloc fetch nclt 2012-01-15              the official archives
  yearloc inspect bags/monday --save conf/dataset/robot.yaml
  yearloc inspect 1326652795280148.bin --format nclt
  yearloc results                            the table, and where the figures are
  yearloc pack campus/10m/sci_ring -o campus.site
  yearloc localize campus.site drive.mcap --json
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse and run; an error that is raised on purpose becomes one line and exit code 1."""
    print_anywhere()
    keep_freed_memory()
    end_when_asked()
    parser = argparse.ArgumentParser(
        "yearloc", description=ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    use = commands.add_parser(
        "use",
        help="choose data sets: check what is on disk, write conf/studies.yaml and conf/lists.yaml",
    )
    options = (
        "names of files in conf/dataset, and root, log, parts, train, tests, learned, methods, "
        "world, budget, scale, question, seeds, variants, altered, cells, poses, paths, latency; "
        "without any, the studies in use"
    )
    use.add_argument("words", nargs="*", metavar="DATASET|KEY=VALUE", help=options)
    use.add_argument(
        "--add", action="store_true", help="beside the studies that are listed already"
    )
    use.add_argument(
        "--keep",
        action="store_true",
        help="leave a list of these data sets, worlds and budgets as it is",
    )
    fetch = commands.add_parser(
        "fetch",
        help="bring official archives: resumed, checked, unpacked, laid as the reader expects them",
    )
    fetch.add_argument("dataset", help="nclt, carmen or nclt_keyframes: a file in conf/fetch")
    fetch.add_argument(
        "words",
        nargs="*",
        metavar="SEQUENCE|KEY=VALUE",
        help="dates; root=FOLDER (data/DATASET), base=ADDRESS",
    )
    look = commands.add_parser(
        "inspect",
        help="say what a file or artifact is: ranges, counts, frames, provenance, warnings",
    )
    look.add_argument("path", type=Path, metavar="FILE-OR-ARTIFACT")
    look.add_argument(
        "--format",
        choices=("nclt", "kitti"),
        help="whose .bin file it is, where its folder does not tell",
    )
    look.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="of bags: write the data set's yaml that is proposed, for conf/dataset",
    )
    results.add_command(commands)
    repro.add_command(commands)
    commands.add_parser(
        "methods",
        help="what can be compared: each method, what it looks at, and where it comes from",
    )
    commands.add_parser(
        "repair",
        help="put right what a kill may leave of DVC's own files; `make demo` does it first",
    )
    site.add_commands(commands)
    grow.add_command(commands)
    picture.add_command(commands)
    given, rest = parser.parse_known_args(arguments)
    if rest and (given.command != "use" or any(word.startswith("-") for word in rest)):
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    if rest:  # argparse takes no words after a flag
        given.words += rest
    try:
        refuse_code_of_another()
        COMMANDS[given.command](given)
    except YearlocError as error:
        print(f"yearloc {given.command}: {one_line(error)}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print(f"yearloc {given.command}: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # a reader such as head has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, MemoryError) as error:
        if not (line := refusal(error)):
            raise
        print(f"yearloc {given.command}: {one_line(line)}", file=sys.stderr)
        sys.exit(1)


def _use(given: argparse.Namespace) -> None:
    from pipeline.running.at_work import refuse_at_work
    from pipeline.studies.expansion import expand
    from pipeline.studies.names import complete, lists_text, propose, studies_text
    from pipeline.studies.parts import lay, parted

    conf = conf_folder()
    datasets = [word for word in given.words if "=" not in word]
    options = dict(word.split("=", 1) for word in given.words if "=" in word)
    if options and not datasets:
        raise ConfigError(
            f"{next(iter(options))}=: of which data set? Call `yearloc use DATASET KEY=VALUE`"
        )
    kept = (given.add or given.keep) and (conf / WRITTEN[0]).exists()
    present = read_studies() if kept or not datasets else {}
    proposals = {dataset: propose(conf, dataset, options) for dataset in datasets}
    wanted = {dataset: proposal.study for dataset, proposal in proposals.items()}
    same = wanted.keys() == present.keys() and all(
        wanted[name][word] == present[name].get(word)
        for name in wanted
        for word in ("world", "budget")
    )
    chosen = (
        present
        if not datasets or (given.keep and same)
        else {**(present if given.add else {}), **wanted}
    )
    studies = complete(conf, chosen)
    texts = {conf / "studies.yaml": studies_text(studies), conf / "lists.yaml": lists_text(studies)}
    changed = {
        path: text
        for path, text in texts.items()
        if not path.is_file() or path.read_bytes() != text.encode()
    }
    if changed:
        refuse_at_work(conf.parent)
    with suppress(ConfigError):  # a broken list is written anew
        for name in sorted(read_studies().keys() - studies.keys()):
            print(f"  {name} is no longer among the studies; --add keeps what is there")
    for path, text in changed.items():
        with replace(path) as scratch:
            scratch.write_text(text, encoding="utf-8")
    lay(conf.parent, parted(expand(studies)))
    print(
        *(f"  {note}\n" for proposal in proposals.values() for note in proposal.notes),
        sep="",
        end="",
    )
    for name, study in studies.items():
        print(
            f"{name}: trained on {study['train']} with the budget {study['budget']}, tested on "
            f"{', '.join(study['tests'])}"
        )


def _fetch(given: argparse.Namespace) -> None:
    from pipeline.fetching.archives import Publisher

    if not (path := conf_folder() / "fetch" / f"{given.dataset}.yaml").is_file():
        known = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise ConfigError(f"no archives of {given.dataset}: expected one of {known}")
    options = dict(word.split("=", 1) for word in given.words if "=" in word)
    sequences = [w for w in given.words if "=" not in w]
    if unknown := sorted(set(options) - {"root", "base"}):
        raise ConfigError(f"fetch has no option {unknown[0]}: expected root or base")
    root = Path(options.pop("root", f"data/{given.dataset}")).expanduser()
    publisher = Publisher.of({**read_yaml(path), **options})
    if not (sequences or publisher.sequences):
        raise ConfigError(f"which sequences of {given.dataset}? Say, for example, 2012-01-15")
    for line in publisher.fetch(root, sequences or publisher.sequences, Bytes()):
        print(f"  {line}", flush=True)
    print(f"next: yearloc use {given.dataset} root={root}")


def _inspect(given: argparse.Namespace) -> None:
    from pipeline.inspection.report import inspect

    if given.save and (
        given.save.parent.resolve() != (conf_folder() / "dataset").resolve()
        or given.save.suffix != ".yaml"
    ):
        raise ConfigError(
            f"--save {given.save}: expected conf/dataset/NAME.yaml, where `yearloc use NAME` finds "
            "it"
        )
    if given.save and given.save.exists():
        raise ConfigError(
            f"--save {given.save}: is there already; remove it first, or give another name"
        )
    if given.path.suffix == ".site":
        from pipeline.online.description import describe

        print(describe(given.path).text(terminal_width()))
        return
    print(inspect(given.path, given.format, own=_own_reader()).text(terminal_width()))
    if given.save:
        from pipeline.inspection.bags import proposal

        with replace(given.save) as scratch:
            scratch.write_text(proposal([given.path]), encoding="utf-8")
        print(
            f"\n{given.save}: written; next: yearloc use {given.save.stem} root=FOLDER, where the "
            "bags of all days are"
        )


def _own_reader() -> "Folder":
    """As the project's conf/dataset/folder.yaml describes it; the usual one outside of a
    project."""
    from pipeline.readers.folder import Folder
    from pipeline.running.building import build

    path = Path("conf/dataset/folder.yaml")
    reader = (
        build(read_yaml(path).get("reader"), ("pipeline.readers.",)) if path.is_file() else Folder()
    )
    if not isinstance(reader, Folder):
        raise ConfigError(f"{path}: expected a reader of the class pipeline.readers.folder.Folder")
    return reader


def _methods(given: argparse.Namespace) -> None:
    from pipeline.studies.catalogue import entries, listing, table

    found = entries(conf_folder())
    whole = table(found)
    width = terminal_width()
    print(whole if max(map(len, whole.splitlines())) <= width else listing(found, width), end="")


def _repair(given: argparse.Namespace) -> None:
    from pipeline.running.at_work import refuse_at_work
    from pipeline.running.repair import repair

    refuse_at_work(Path())
    for lock in repair(Path()):
        print(
            f"{lock}: was torn by a kill and is empty now; what is finished comes back from DVC's "
            "cache"
        )
    check_files(conf_folder())


COMMANDS = {one.__name__[1:]: one for one in (_use, _fetch, _inspect, _methods, _repair)} | {
    "results": results.results,
    "repro": repro.repro,
    "localize": localize,
    "failures": failures,
    "picture": picture.picture,
    "pack": site.pack,
    "grow": grow.grow,
    "kernels": site.kernels,
    "export": site.export,
    "serve": site.serve,
    "watch": site.watch,
}
