"""`yearloc fetch` downloads the archives of a data set; `yearloc inspect` says what a file is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pipeline.cli.options import some_words
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Bar, Bytes
from pipeline.cli.project import conf_folder
from pipeline.core.errors import ConfigError
from pipeline.core.replacing import write_text
from pipeline.running.texts import read_yaml, terminal_width

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.inspection.inspection import Inspection
    from pipeline.readers.folder import Folder


def fetch(
    dataset: Annotated[
        str,
        typer.Argument(
            metavar="DATASET",
            help="The data set: nclt, carmen or nclt_keyframes, each a file in conf/fetch",
        ),
    ],
    words: Annotated[
        list[str],
        some_words(
            "SEQUENCE|KEY=VALUE",
            "Sequences to download, such as 2012-01-15; root=FOLDER is where they go (default "
            "data/DATASET), base=ADDRESS the server or mirror that has them",
        ),
    ],
) -> None:
    """Download a data set's official archives, check them, and unpack them for its reader."""
    from pipeline.fetching.archives import Publisher

    if not (path := conf_folder() / "fetch" / f"{dataset}.yaml").is_file():
        names = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise ConfigError(f"no archives of {dataset}: expected one of {names}")
    options = dict(word.split("=", 1) for word in words if "=" in word)
    sequences = [word for word in words if "=" not in word]
    if unknown := sorted(set(options) - {"root", "base"}):
        raise ConfigError(f"fetch has no option {unknown[0]}: expected root or base")
    root = Path(options.pop("root", f"data/{dataset}")).expanduser()
    publisher = Publisher.of({**read_yaml(path), **options})
    sequences = sequences or [*publisher.sequences]
    if not sequences:
        raise ConfigError(f"fetch {dataset}: expected sequences to download, such as 2012-01-15")
    for line in publisher.fetch(root, sequences, Bytes()):
        print(f"  {line}", flush=True)
    print(f"next: yearloc use {dataset} root={root}")


def inspect(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="FILE-OR-ARTIFACT",
            help="A raw file, a bag, the folder of a log, a 3-D map, a site file or an artifact "
            "of the chain",
        ),
    ],
    format_name: Annotated[
        Literal["nclt", "kitti", "map"] | None,
        typer.Option(
            "--format",
            help="The format of a single .bin file, by default guessed from its folder; map: a "
            "3-D map, though it looks like a scan",
        ),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="For bags: write the proposed data set to this new file, conf/dataset/NAME.yaml",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="For a 3-D map: draw it from above into this .png"),
    ] = None,
) -> None:
    """Describe a file or artifact: ranges, counts, frames, provenance, warnings."""
    from pipeline.inspection import report

    if save:
        _check_save(save)
    if picture:
        check_file(picture)
        if picture.suffix != ".png":
            raise ConfigError(f"--picture {picture}: expected a .png")
    if path.suffix == ".site":
        from pipeline.online.description import describe

        print(describe(path).text(terminal_width()))
        return
    found = report.inspect(path, format_name, folder_reader=_folder_reader(), progress=Bar())
    if picture:
        _draw(found, picture)
    print(found.text(terminal_width()))
    if save:
        _save_proposal(path, save)


def _draw(found: "Inspection", picture: Path) -> None:
    """Draw the 3-D map that was found; raises ConfigError if there is none."""
    from pipeline.report.figures import map_from_above

    if found.point_map is None or found.point_map.ground is None:
        raise ConfigError(f"--picture {picture}: {found.path} is no 3-D map that can be drawn")
    map_from_above.write(found.point_map, picture)
    found.add("picture", ("drawn", str(picture)))


def _check_save(save: Path) -> None:
    """Raise ConfigError unless `save` is a new yaml in conf/dataset."""
    if save.parent.resolve() != (conf_folder() / "dataset").resolve() or save.suffix != ".yaml":
        raise ConfigError(
            f"--save {save}: expected conf/dataset/NAME.yaml, where `yearloc use NAME` finds it"
        )
    if save.exists():
        raise ConfigError(f"--save {save}: is there already; remove it first, or give another name")


def _save_proposal(bags: Path, save: Path) -> None:
    """Write the yaml of a data set that is proposed for bags, and say what to call next."""
    from pipeline.inspection.bags import proposal

    write_text(save, proposal([bags]))
    has_ground_truth = read_yaml(save)["reader"]["ground_truth"] is not None
    further_words = "" if has_ground_truth else " train=DRIVE poses=slam"
    print(
        f"\n{save}: written; next: yearloc use {save.stem} root=FOLDER{further_words}, where the "
        "bags of all days are"
    )


def _folder_reader() -> "Folder":
    """The reader of a user's own folders of scans."""
    from pipeline.core.building import build
    from pipeline.readers.folder import Folder
    from pipeline.readers.log import READERS

    path = Path("conf/dataset/folder.yaml")
    reader = build(read_yaml(path).get("reader"), READERS) if path.is_file() else Folder()
    if not isinstance(reader, Folder):
        raise ConfigError(f"{path}: expected a reader of the class pipeline.readers.folder.Folder")
    return reader
