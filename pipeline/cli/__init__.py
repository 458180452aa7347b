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
    """Run the command that the arguments name; a YearlocError becomes one line and exit code 1."""
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
    args, extra_words = parser.parse_known_args(arguments)
    if extra_words and (args.command != "use" or any(word.startswith("-") for word in extra_words)):
        parser.error(f"unrecognized arguments: {' '.join(extra_words)}")
    if extra_words:  # argparse takes no words after a flag
        args.words += extra_words
    try:
        refuse_code_of_another()
        COMMANDS[args.command](args)
    except YearlocError as error:
        print(f"yearloc {args.command}: {one_line(error)}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print(f"yearloc {args.command}: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # a reader such as head has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, MemoryError) as error:
        if not (line := refusal(error)):
            raise
        print(f"yearloc {args.command}: {one_line(line)}", file=sys.stderr)
        sys.exit(1)


def _use(args: argparse.Namespace) -> None:
    from pipeline.running.at_work import refuse_at_work
    from pipeline.studies.expansion import expand
    from pipeline.studies.known import refuse_unknown
    from pipeline.studies.names import lists_text, studies_text
    from pipeline.studies.parts import lay, parted
    from pipeline.studies.proposal import propose

    conf = conf_folder()
    datasets = [word for word in args.words if "=" not in word]
    options = dict(word.split("=", 1) for word in args.words if "=" in word)
    if options and not datasets:
        raise ConfigError(
            f"{next(iter(options))}=: of which data set? Call `yearloc use DATASET KEY=VALUE`"
        )
    keeps_listed = (args.add or args.keep) and (conf / WRITTEN[0]).exists()
    listed_studies = read_studies() if keeps_listed or not datasets else {}
    proposals = {dataset: propose(conf, dataset, options) for dataset in datasets}
    proposed_studies = {dataset: proposal.study for dataset, proposal in proposals.items()}
    is_unchanged = proposed_studies.keys() == listed_studies.keys() and all(
        (proposed.world, proposed.budget)
        == (listed_studies[name].world, listed_studies[name].budget)
        for name, proposed in proposed_studies.items()
    )
    studies = (
        listed_studies
        if not datasets or (args.keep and is_unchanged)
        else {**(listed_studies if args.add else {}), **proposed_studies}
    )
    for study in studies.values():
        refuse_unknown(conf, study)
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
            f"{name}: trained on {study.train_text} with the budget {study.budget}, tested on "
            f"{', '.join(study.tests)}"
        )


def _fetch(args: argparse.Namespace) -> None:
    from pipeline.fetching.archives import Publisher

    if not (path := conf_folder() / "fetch" / f"{args.dataset}.yaml").is_file():
        names = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise ConfigError(f"no archives of {args.dataset}: expected one of {names}")
    options = dict(word.split("=", 1) for word in args.words if "=" in word)
    sequences = [w for w in args.words if "=" not in w]
    if unknown := sorted(set(options) - {"root", "base"}):
        raise ConfigError(f"fetch has no option {unknown[0]}: expected root or base")
    root = Path(options.pop("root", f"data/{args.dataset}")).expanduser()
    publisher = Publisher.of({**read_yaml(path), **options})
    if not (sequences or publisher.sequences):
        raise ConfigError(f"which sequences of {args.dataset}? Say, for example, 2012-01-15")
    for line in publisher.fetch(root, sequences or publisher.sequences, Bytes()):
        print(f"  {line}", flush=True)
    print(f"next: yearloc use {args.dataset} root={root}")


def _inspect(args: argparse.Namespace) -> None:
    from pipeline.inspection.report import inspect

    if args.save and (
        args.save.parent.resolve() != (conf_folder() / "dataset").resolve()
        or args.save.suffix != ".yaml"
    ):
        raise ConfigError(
            f"--save {args.save}: expected conf/dataset/NAME.yaml, where `yearloc use NAME` finds "
            "it"
        )
    if args.save and args.save.exists():
        raise ConfigError(
            f"--save {args.save}: is there already; remove it first, or give another name"
        )
    if args.path.suffix == ".site":
        from pipeline.online.description import describe

        print(describe(args.path).text(terminal_width()))
        return
    print(inspect(args.path, args.format, folder_reader=_own_reader()).text(terminal_width()))
    if args.save:
        from pipeline.inspection.bags import proposal

        with replace(args.save) as scratch:
            scratch.write_text(proposal([args.path]), encoding="utf-8")
        print(
            f"\n{args.save}: written; next: yearloc use {args.save.stem} root=FOLDER, where the "
            "bags of all days are"
        )


def _own_reader() -> "Folder":
    """The reader of the user's own scan folders.

    It is set up by the project's conf/dataset/folder.yaml, or by its defaults outside of a project.
    """
    from pipeline.readers.folder import Folder
    from pipeline.running.building import build

    path = Path("conf/dataset/folder.yaml")
    reader = (
        build(read_yaml(path).get("reader"), ("pipeline.readers.",)) if path.is_file() else Folder()
    )
    if not isinstance(reader, Folder):
        raise ConfigError(f"{path}: expected a reader of the class pipeline.readers.folder.Folder")
    return reader


def _methods(args: argparse.Namespace) -> None:
    from pipeline.studies.catalogue import entries, listing, table

    methods = entries(conf_folder())
    whole = table(methods)
    width = terminal_width()
    print(whole if max(map(len, whole.splitlines())) <= width else listing(methods, width), end="")


def _repair(args: argparse.Namespace) -> None:
    from pipeline.running.at_work import refuse_at_work
    from pipeline.running.repair import repair

    refuse_at_work(Path())
    for lock in repair(Path()):
        print(
            f"{lock}: was torn by a kill and is empty now; what is finished comes back from DVC's "
            "cache"
        )
    check_files(conf_folder())


COMMANDS = {
    command.__name__[1:]: command for command in (_use, _fetch, _inspect, _methods, _repair)
} | {
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
