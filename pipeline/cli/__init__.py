"""The `yearloc` command: gathers the functions of all commands, and runs the one that is called.

Each module here has one command or two: a function whose signature declares the options. It imports
what loads slowly only when it is called: `yearloc --help` needs none of it. `main` turns an error
that a person can put right into one line and an exit code.
"""

import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from pipeline.cli.calibrate import calibrate
from pipeline.cli.data import fetch, inspect
from pipeline.cli.example import example
from pipeline.cli.failures import failures
from pipeline.cli.kernels import kernels
from pipeline.cli.localize import localize
from pipeline.cli.picture import picture
from pipeline.cli.project import refuse_code_of_another
from pipeline.cli.repro import repair, repro
from pipeline.cli.results import results
from pipeline.cli.serve import serve
from pipeline.cli.site import export, pack
from pipeline.cli.slam import slam
from pipeline.cli.studies import methods, use
from pipeline.cli.update import update
from pipeline.cli.watch import watch
from pipeline.core.errors import YearlocError, machine_refusal
from pipeline.running.process import end_when_asked, keep_freed_memory
from pipeline.running.texts import one_line, print_anywhere

ABOUT = """\
Learn a place from LiDAR on one day, localise in it for a year.

DVC runs a chain of stages from raw logs to a report: `dvc repro` builds
whatever is out of date. This command chooses the data for the chain, shows
its results, and uses its models on new scans.

  yearloc example                            localise three scans in a minute
  yearloc use campus town                    simulated data sets: no download
  yearloc use nclt root=/data/nclt           NCLT as its archives unpack
  yearloc use robotcar root=/data/robotcar   2-D sweeps along the odometry
  yearloc use kitti root=/data/kitti log=00  train on the start of a log, test on its rest
  yearloc fetch nclt 2012-01-15              download the official archives
  yearloc inspect bags/monday --save conf/dataset/robot.yaml
  yearloc inspect 1326652795280148.bin --format nclt
  yearloc slam bags/monday -o poses.txt      estimate the poses of a log
  yearloc results                            print the results and where the figures are
  yearloc pack campus/10m/sci_ring -o campus.site
  yearloc localize campus.site drive.mcap --json
"""
GROUPS: dict[str, tuple[Callable[..., None], ...]] = {
    "see it work": (example,),
    "get data": (fetch, inspect, slam),
    "build": (use, repro, repair),
    "look": (results, methods, picture, failures),
    "deploy": (pack, calibrate, localize, watch, serve, update, export, kernels),
}
"""The commands, in the order and under the headings of `yearloc --help`."""
COMPLETION = "_YEARLOC_COMPLETE"
"""The environment variable by which a shell requests completions of a command line."""


class Command(TyperCommand):
    """A command that refuses to run in a copied project whose .venv runs the original's code."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; raises ConfigError if another project's code would run."""
        refuse_code_of_another()
        return super().invoke(ctx)


app = typer.Typer(
    help=ABOUT,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)
COMMANDS = {
    function.__name__: app.command(cls=Command, rich_help_panel=group)(function)
    for group, functions in GROUPS.items()
    for function in functions
}
"""The functions of the commands, by the words that name them on the command line."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command that the arguments name, by default those of the process.

    A YearlocError becomes one line and exit code 1, a wrong command line becomes one line and exit
    code 2.
    """
    print_anywhere()
    keep_freed_memory()
    end_when_asked()
    if os.environ.get(COMPLETION):
        app(prog_name="yearloc")  # typer answers the shell and exits
    words = sys.argv[1:] if arguments is None else [*arguments]
    is_command = bool(words) and words[0] in COMMANDS
    command = f" {words[0]}" if is_command else ""
    try:
        _invoke(words)
    except typer.TyperException as error:
        mistake = one_line(_mistake(error))
        print(
            f"yearloc{command}: {mistake}; `yearloc{command} --help` shows what is needed",
            file=sys.stderr,
        )
        sys.exit(error.exit_code)
    except YearlocError as error:
        print(f"yearloc{command}: {one_line(error)}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print(f"yearloc{command}: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # whatever reads the output, such as head, has seen enough
        # Python flushes the output when it ends; there it must not meet the broken pipe again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, MemoryError) as error:
        if not (refusal := machine_refusal(error)):
            raise
        print(f"yearloc{command}: {one_line(refusal)}", file=sys.stderr)
        sys.exit(1)


def _invoke(words: Sequence[str]) -> None:
    """Parse the command line and call the command's function."""
    commands = get_command(app)
    try:
        with commands.make_context("yearloc", [*words]) as context:
            commands.invoke(context)
    except typer.Exit as end:  # such as after --help
        sys.exit(end.exit_code)
    except SystemExit as end:
        # rich exits when its output is no longer read; that is no failure
        if not isinstance(end.__context__, BrokenPipeError):
            raise


def _mistake(error: typer.TyperException) -> str:
    """What is wrong in the command line; if a value cannot be parsed, with the value."""
    match error:
        case typer.BadParameter(param_hint=str() as name):
            return f"{name}: {error.message}"
        case typer.BadParameter(param=parameter, __cause__=cause) if parameter and cause:
            validation_error: Any = cause  # pydantic's
            first_error, *_ = validation_error.errors()
            value = first_error["input"]
            expected = first_error["msg"].removeprefix("Value error, ").rstrip(".")
            for words in (f"{value!r} is not", "Input should be"):
                expected = expected.replace(words, "expected")
            *_, long_option = parameter.opts  # -o, --out
            return f"{long_option} {value}: {expected}"
    return error.format_message().rstrip(".")
