"""Stage `poses`: registers each query with the map, and decides whether to accept the pose.

The candidates come from a method's ranking of places. Each query's points are registered with the
map's submaps there; the likeliest pose is the query's fix. The stage writes the fixes of each test
sequence: the pose, the places re-ranked by it, the error probability (one minus the probability
that the pose is right), and the thresholds from which on a pose is rejected. The thresholds reach
their target precisions on validation blocks of the training sequence. The verdict learned from
these blocks is written beside the fixes, for `yearloc pack`.

The sweeps of a level 2-D laser are searched for in a grid of the whole map instead.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.errors import InputError
from pipeline.core.frames import LEVEL_RIGHT_WITHIN, RIGHT_WITHIN
from pipeline.core.settings import Count, Names, Share
from pipeline.level.day import LevelDay, sweeps_basis
from pipeline.level.validation import LevelValidation, Sweeps
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows
from pipeline.posing.answers import PosedQuery, Posing
from pipeline.posing.learned_verdict import VERDICT, Learned, basis
from pipeline.posing.map_verdict import NOT_CALIBRATED, usual
from pipeline.posing.queries import Queries
from pipeline.posing.search import Fixer
from pipeline.posing.validation import Drive, TrainingDay
from stages import EachSequence, ProgressBar, build, stage


@dataclass(frozen=True)
class Budget:
    """The settings of a file of conf/budget that this stage uses."""

    poses: Mapping[str, Any] | None = None
    """Fields of the fixer that the budget changes."""


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/poses.yaml."""

    method: Any
    """The method that ranked the places: a file of conf/method."""
    view: Any
    """The method's view: a file of conf/view."""
    budget: Budget
    train: str
    model: Path
    views: Path
    rankings: Path
    """Folder of the method's own rankings."""
    others: Names = ()
    """Folders of other methods' rankings, whose places are candidates too."""
    perturbations: Names = ()
    """The perturbations whose queries `localize` answered too: files of conf/perturbation."""
    map: Path
    labels: Path
    scans: Path
    submaps: Path
    k: Count
    """Number of candidate places of each ranking."""
    target_precision: Share
    """The target precision of accepted poses."""
    unseen_share: Share
    """The expected share of unseen queries, which the thresholds depend on."""
    validation: DictConfig
    """Chooses and registers the validation blocks of the training sequence."""
    fixer: DictConfig
    """Registers a query at its candidate places."""


PosedQueries = Callable[[str], list[PosedQuery]]
"""Finds the poses of the queries of a test sequence, given by its name."""


@stage("poses")
def main(settings: Settings) -> str:
    name = f"{settings.train}.zarr"
    labels = store.read(settings.labels / name, schemas.Labels)
    targets = store.read(settings.map / name, schemas.Maps, schemas.TiledMaps)
    sweeps = Sweeps.of(store.read(settings.scans / name, schemas.Scans), is_posed=True)
    with instantiate(settings.compute) as compute, store.replace(settings.out) as folder:
        folder.mkdir()
        # learn the verdict from the training day
        is_map = isinstance(targets, schemas.TiledMaps)
        is_level = not is_map and sweeps.is_level
        right_within = LEVEL_RIGHT_WITHIN if is_level else RIGHT_WITHIN
        if is_map:
            learned, posed_queries = usual_of_map(settings)
            learned_with = scans_basis(settings)
        elif is_level:
            learned, posed_queries = learned_of_sweeps(settings, sweeps)
            learned_with = sweeps_basis(sweeps, settings.unseen_share)
        else:
            learned, posed_queries = learned_of_scans(settings, labels, compute)
            learned_with = scans_basis(settings)
        learned.write(folder / f"{VERDICT}.zarr", learned_with)
        lines = [
            f"{learned.fix_count} fixes of {learned.verdict.validation_blocks} validation blocks"
        ]
        if is_map:
            lines = [f"the usual probabilities, {NOT_CALIBRATED}"]
        posing = Posing(
            learned.verdict,
            right_within,
            Places.of(labels),
            settings.target_precision,
        )
        # pose the queries of each test sequence
        sequences = settings.sequences
        queries_of_sequences = compute.each(posed_queries, sequences)
        tracked = ProgressBar().track(queries_of_sequences, len(sequences), "register")
        for sequence, queries in zip(sequences, tracked, strict=True):
            rankings = store.read(settings.rankings / f"{sequence}.zarr", schemas.Rankings)
            lines.append(posing.write(folder / f"{sequence}.zarr", rankings, queries))
    return "; ".join(lines)


def learned_of_scans(
    settings: Settings, labels: schemas.Labels, compute: Compute
) -> tuple[Learned, PosedQueries]:
    """Register validation blocks of 3-D scans with the map; returns what they teach, and a function
    for the queries."""
    name = f"{settings.train}.zarr"
    fixer = instantiate(settings.fixer, **(settings.budget.poses or {}))
    day = TrainingDay(
        settings.map / name,
        Drive(settings.scans / name, settings.submaps / name),
        Rows.read(settings.views / name),
        labels.places,
        settings.view,
        settings.method.localizer(store.read_model(settings.model)),
        settings.k,
    )
    validation = instantiate(settings.validation)
    evidence = validation.evidence(fixer, day, compute, ProgressBar())
    learned = Learned.of(evidence, evidence.verdict(settings.unseen_share))
    return learned, poser_of_scans(settings, learned.tuned(fixer), learned)


def usual_of_map(settings: Settings) -> tuple[Learned, PosedQueries]:
    """What is known of fixes in a 3-D map without validation blocks, and a function for the
    queries."""
    learned, fixer = usual(instantiate(settings.fixer, **(settings.budget.poses or {})))
    return learned, poser_of_scans(settings, fixer, learned)


def poser_of_scans(settings: Settings, fixer: Fixer, learned: Learned) -> PosedQueries:
    """The function that registers the queries of a sequence of 3-D scans with the map."""
    map_path = settings.map / f"{settings.train}.zarr"
    judge = learned.judge

    def posed_queries(sequence: str) -> list[PosedQuery]:
        """Pose the queries of one sequence; it may run in a process of its own."""
        perturbations = [build("perturbation", name) for name in settings.perturbations]
        rankings = (str(settings.rankings), *settings.others)
        queries = Queries(
            sequence, str(settings.scans), str(settings.submaps), rankings, perturbations
        )
        return [PosedQuery.of(fix, judge) for fix in queries.fixes(fixer, map_path, settings.k)]

    return posed_queries


def scans_basis(settings: Settings) -> str:
    """The basis of the verdict on 3-D scans."""
    fixer = OmegaConf.merge(settings.fixer, settings.budget.poses or {})
    return basis(
        settings.model.read_bytes(),
        fixer=OmegaConf.to_container(fixer),
        validation=OmegaConf.to_container(settings.validation),
        k=settings.k,
        unseen_share=settings.unseen_share,
    )


def learned_of_sweeps(settings: Settings, sweeps: Sweeps) -> tuple[Learned, PosedQueries]:
    """Localise validation stretches of level sweeps; returns what they teach, and a function for
    the queries."""
    day = LevelDay.of(sweeps, settings.unseen_share, LevelValidation())

    def posed_queries(sequence: str) -> list[PosedQuery]:
        """Pose the queries of one sequence; it may run in a process of its own."""
        name = f"{sequence}.zarr"
        rankings = store.read(settings.rankings / name, schemas.Rankings)
        if len(rankings.cases) > 1:
            raise InputError(
                f"{rankings.path}: perturbed queries, but level sweeps are localised unperturbed "
                "only; leave perturbed= or poses= empty"
            )
        submaps = store.read(settings.submaps / name, schemas.Submaps)
        scans = store.read(settings.scans / name, schemas.Scans)
        return day.queries(scans, submaps.load("scans"))

    return day.learned, posed_queries


if __name__ == "__main__":
    main()
