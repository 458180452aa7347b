"""`yearloc use` chooses what the chain runs on; `yearloc methods` lists what it can compare.

`use` proposes a study of each data set that is named (its training and test days, and methods to
compare) and writes them to conf/studies.yaml, with the lists that dvc.yaml expands to.
"""

from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import some_words
from pipeline.cli.project import conf_folder, read_studies
from pipeline.core.errors import ConfigError
from pipeline.core.replacing import write_text
from pipeline.running.texts import terminal_width

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from collections.abc import Mapping

    from pipeline.studies.study import Study

OPTIONS = (
    "Data sets (files in conf/dataset) and options of their studies: root, map, log, split, "
    "train, tests, learned, methods, world, budget, scale, experiment, seeds, variants, "
    "perturbed, cells, poses, paths, latency; without any, the studies in use are written again"
)


def use(
    words: Annotated[
        list[str],
        some_words("DATASET|KEY=VALUE", OPTIONS),
    ],
    add: Annotated[
        bool, typer.Option("--add", help="Keep the studies that are listed already")
    ] = False,
    keep: Annotated[
        bool,
        typer.Option(
            "--keep",
            help="Change nothing if the list has exactly these data sets, worlds and budgets",
        ),
    ] = False,
) -> None:
    """Choose data sets: check their files, write conf/studies.yaml and conf/lists.yaml."""
    from pipeline.studies.proposal import propose
    from pipeline.studies.studies_file import refuse_unknown

    conf = conf_folder()
    datasets = [word for word in words if "=" not in word]
    options = dict(word.split("=", 1) for word in words if "=" in word)
    if options and not datasets:
        raise ConfigError(
            f"{next(iter(options))}=: of which data set? Call `yearloc use DATASET KEY=VALUE`"
        )
    # the studies that are in use, if the answer depends on them
    listed_studies = {}
    has_list = (conf / "studies.yaml").exists()
    if not datasets or (has_list and (add or keep)):
        listed_studies = read_studies()
    # the studies of the data sets that are named
    proposals = {dataset: propose(conf, dataset, options) for dataset in datasets}
    proposed_studies = {dataset: study for dataset, (study, _) in proposals.items()}
    if not datasets or (keep and _have_same_choices(proposed_studies, listed_studies)):
        studies = listed_studies
    elif add:
        studies = {**listed_studies, **proposed_studies}
    else:
        studies = proposed_studies
    for study in studies.values():
        refuse_unknown(conf, study)
    _write(conf, studies)
    for note in chain.from_iterable(notes for _, notes in proposals.values()):
        print(f"  {note}")
    for name, study in studies.items():
        print(
            f"{name}: trained on {study.train_text} with the budget {study.budget}, tested on "
            f"{', '.join(study.tests)}"
        )


def _have_same_choices(
    proposed_studies: "Mapping[str, Study]", listed_studies: "Mapping[str, Study]"
) -> bool:
    """Whether two lists of studies agree in their data sets, worlds and budgets."""
    if proposed_studies.keys() != listed_studies.keys():
        return False
    for name, study in proposed_studies.items():
        listed_study = listed_studies[name]
        if (study.world, study.budget) != (listed_study.world, listed_study.budget):
            return False
    return True


def _write(conf: Path, studies: "Mapping[str, Study]") -> None:
    """Write conf/studies.yaml and conf/lists.yaml, and the parts of dag/ for a long list of drives.

    Prints which studies were removed. Raises ConfigError while DVC is running in the project.
    """
    from pipeline.running.at_work import refuse_at_work
    from pipeline.studies.expansion import expand
    from pipeline.studies.parts import split_drives, write_parts
    from pipeline.studies.studies_file import lists_text, studies_text

    texts = {conf / "studies.yaml": studies_text(studies), conf / "lists.yaml": lists_text(studies)}
    changed_texts = {
        path: text
        for path, text in texts.items()
        if not path.is_file() or path.read_bytes() != text.encode()
    }
    if changed_texts:
        refuse_at_work(conf.parent)
    with suppress(ConfigError):  # a list that cannot be read is rewritten
        for name in sorted(read_studies().keys() - studies.keys()):
            print(f"  {name} is no longer among the studies; --add keeps what is there")
    for path, text in changed_texts.items():
        write_text(path, text)
    write_parts(conf.parent, split_drives(expand(studies)))


def methods() -> None:
    """List the methods that can be compared, with the view that each uses and its source."""
    from pipeline.studies.catalogue import entries, listing, table

    catalogue = entries(conf_folder())
    text = table(catalogue)
    width = terminal_width()
    if max(map(len, text.splitlines())) > width:
        text = listing(catalogue, width)
    print(text, end="")
