"""`yearloc use` and `yearloc methods`: what the chain runs on, and what it can compare."""

from contextlib import suppress
from typing import Annotated

import typer

from pipeline.cli.options import some_words
from pipeline.cli.project import conf_folder, read_studies
from pipeline.core.errors import ConfigError
from pipeline.core.replacing import replace
from pipeline.running.texts import WRITTEN, terminal_width

OPTIONS = (
    "names of files in conf/dataset, and root, log, parts, train, tests, learned, methods, world, "
    "budget, scale, question, seeds, variants, altered, cells, poses, paths, latency; without any, "
    "the studies in use"
)


def use(
    words: Annotated[
        list[str],
        some_words("DATASET|KEY=VALUE", OPTIONS),
    ],
    add: Annotated[
        bool, typer.Option("--add", help="beside the studies that are listed already")
    ] = False,
    keep: Annotated[
        bool,
        typer.Option("--keep", help="leave a list of these data sets, worlds and budgets as it is"),
    ] = False,
) -> None:
    """Choose data sets: check what is on disk, write conf/studies.yaml and conf/lists.yaml."""
    from pipeline.running.at_work import refuse_at_work
    from pipeline.studies.expansion import expand
    from pipeline.studies.known import refuse_unknown
    from pipeline.studies.names import lists_text, studies_text
    from pipeline.studies.parts import lay, parted
    from pipeline.studies.proposal import propose

    conf = conf_folder()
    datasets = [word for word in words if "=" not in word]
    options = dict(word.split("=", 1) for word in words if "=" in word)
    if options and not datasets:
        raise ConfigError(
            f"{next(iter(options))}=: of which data set? Call `yearloc use DATASET KEY=VALUE`"
        )
    keeps_listed = (add or keep) and (conf / WRITTEN[0]).exists()
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
        if not datasets or (keep and is_unchanged)
        else {**(listed_studies if add else {}), **proposed_studies}
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


def methods() -> None:
    """What can be compared: each method, what it looks at, and where it comes from."""
    from pipeline.studies.catalogue import entries, listing, table

    catalogue = entries(conf_folder())
    whole = table(catalogue)
    width = terminal_width()
    print(
        whole if max(map(len, whole.splitlines())) <= width else listing(catalogue, width), end=""
    )
