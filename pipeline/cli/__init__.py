"""The `yearloc` command."""

import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from pipeline.cli.data import fetch, inspect
from pipeline.cli.example import example
from pipeline.cli.failures import failures
from pipeline.cli.grow import grow
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
from pipeline.cli.watch import watch
from pipeline.core.errors import YearlocError, machine_refusal
from pipeline.running.ending import end_when_asked
from pipeline.running.memory import keep_freed_memory
from pipeline.running.texts import one_line, print_anywhere

ABOUT = """\
Learn a place from LiDAR on one day, localise in it for a year.

The work itself is a chain of stages that DVC runs: `dvc repro` builds
whatever is out of date, from raw logs to a report. This command chooses what
the chain runs on, and looks at what it made.

  yearloc example                            one minute: a site that is ready
  yearloc use campus town                    simulated: no data are needed
  yearloc use nclt root=/data/nclt           NCLT as its archives unpack
  yearloc use robotcar root=/data/robotcar   2-D sweeps along the odometry
  yearloc use kitti root=/data/kitti log=00  part of a log, then the rest
  yearloc fetch nclt 2012-01-15              the official archives
  yearloc inspect bags/monday --save conf/dataset/robot.yaml
  yearloc inspect 1326652795280148.bin --format nclt
  yearloc slam bags/monday -o poses.txt      poses of a log that has none
  yearloc results                            the table; where the figures are
  yearloc pack campus/10m/sci_ring -o campus.site
  yearloc localize campus.site drive.mcap --json
"""
GROUPS: dict[str, tuple[Callable[..., None], ...]] = {
    "see it work": (example,),
    "get data": (fetch, inspect, slam),
    "build": (use, repro, repair),
    "look": (results, methods, picture, failures),
    "deploy": (pack, localize, watch, serve, grow, export, kernels),
}
"""The commands, in the order and under the headings of `yearloc --help`."""
COMPLETION = "_YEARLOC_COMPLETE"
"""The variable by which a shell asks for the words that may come next."""


class Command(TyperCommand):
    """A command of this project, not of the one that the folder was copied from."""

    def invoke(self, ctx: Any) -> Any:
        """Run it; raises ConfigError where another project's code would run."""
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
"""The functions by the words that name them on the command line."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command that the arguments name.

    A YearlocError becomes one line and exit code 1, a wrong command line one and exit code 2.
    """
    print_anywhere()
    keep_freed_memory()
    end_when_asked()
    if os.environ.get(COMPLETION):
        app(prog_name="yearloc")
    commands = get_command(app)
    words = sys.argv[1:] if arguments is None else [*arguments]
    command = "".join(f" {word}" for word in words[:1] if word in COMMANDS)
    try:
        with commands.make_context("yearloc", words) as context:
            commands.invoke(context)
    except typer.Exit as ended:
        sys.exit(ended.exit_code)
    except SystemExit as ended:
        if not isinstance(ended.__context__, BrokenPipeError):  # of which rich makes one
            raise
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
    except BrokenPipeError:  # a reader such as head has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, MemoryError) as error:
        if not (line := machine_refusal(error)):
            raise
        print(f"yearloc{command}: {one_line(line)}", file=sys.stderr)
        sys.exit(1)


def _mistake(error: typer.TyperException) -> str:
    """What is wrong in the command line; of a value that cannot be parsed, with the value."""
    match error:
        case typer.BadParameter(param_hint=str() as name):
            return f"{name}: {error.message}"
        case typer.BadParameter(param=parameter, __cause__=cause) if parameter and cause:
            validation: Any = cause  # pydantic's
            refused = validation.errors()[0]
            expected = refused["msg"].removeprefix("Value error, ").rstrip(".")
            for words in (f"{refused['input']!r} is not", "Input should be"):
                expected = expected.replace(words, "expected")
            return f"{parameter.opts[-1]} {refused['input']}: {expected}"
    return error.format_message().rstrip(".")
