"""Rankings and the map → a pose of each query, its places re-ranked, and whether to believe it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.errors import InputError
from pipeline.core.settings import Count, Names, Share
from pipeline.level import verdict as level_verdict
from pipeline.level.day import LevelDay
from pipeline.level.held_out import LevelHeldOut, Sweeps
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows
from pipeline.posing.answers import PosedQuery, Posing
from pipeline.posing.held_out import Drive, TrainingDay
from pipeline.posing.queries import Queries
from pipeline.posing.verdict import BELIEFS, RIGHT_WITHIN, Verdict
from stages import EachSequence, ProgressBar, build, stage


@dataclass(frozen=True)
class Budget:
    """What the stage takes of a file of conf/budget."""

    poses: Mapping[str, Any] | None = None
    """Fields of the fixer that have another value."""


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/poses.yaml."""

    method: Any
    view: Any
    budget: Budget
    train: str
    model: Path
    views: Path
    rankings: Path
    """Folder of the method's own rankings."""
    others: Names = ()
    """Folders of other methods' rankings, whose places are candidates too."""
    alterations: Names = ()
    """Of some test sequences, as localize was asked."""
    map: Path
    labels: Path
    scans: Path
    submaps: Path
    k: Count
    """Candidate places of each ranking."""
    wanted_precision: Share
    unseen_share: Share
    held_out: Any
    fixer: DictConfig


@dataclass(frozen=True)
class Learned:
    """What the training day says of poses, and how the queries of a sequence are asked."""

    limits: Mapping[str, Sequence[float]]
    """The doubt from which to reject each of BELIEFS, by promise."""
    fixes: int
    """Of held-out stretches."""
    blocks: int
    right_within: tuple[float, float]
    """Metres and degrees."""
    queries: Callable[[str], list[PosedQuery]]


@stage("poses")
def main(settings: Settings) -> str:
    name = f"{settings.train}.zarr"
    labels = store.read(settings.labels / name, schemas.Labels)
    sweeps = Sweeps.of(store.read(settings.scans / name, schemas.Scans), is_posed=True)
    with instantiate(settings.compute) as compute, store.replace(settings.out) as folder:
        folder.mkdir()
        learned = (
            learned_level(settings, sweeps)
            if sweeps.is_level
            else learned_standing(settings, labels, compute)
        )
        posing = Posing(
            learned.limits,
            learned.blocks,
            learned.right_within,
            Places.of(labels),
            settings.wanted_precision,
        )
        lines = [f"{learned.fixes} fixes of {learned.blocks} held-out blocks"]
        sequences = settings.sequences
        queries_by_sequence = compute.each(learned.queries, sequences)
        for sequence, queries in zip(
            sequences,
            ProgressBar().track(queries_by_sequence, len(sequences), "register"),
            strict=True,
        ):
            rankings = store.read(settings.rankings / f"{sequence}.zarr", schemas.Rankings)
            lines.append(posing.write(folder / f"{sequence}.zarr", rankings, queries))
    return "; ".join(lines)


def learned_standing(settings: Settings, labels: schemas.Labels, compute: Compute) -> Learned:
    """Register held-out blocks of 3-D scans with the map; queries are registered alike."""
    name = f"{settings.train}.zarr"
    fixer = instantiate(settings.fixer, **(settings.budget.poses or {}))
    map_path = settings.map / name
    day = TrainingDay(
        map_path,
        Drive(settings.scans / name, settings.submaps / name),
        Rows.read(settings.views / name),
        labels.places,
        settings.view,
        settings.method.localizer(store.read_model(settings.model)),
        settings.k,
    )
    evidence = settings.held_out.evidence(fixer, day, compute, ProgressBar())
    verdict = Verdict(evidence, settings.unseen_share)
    judge = verdict.judge
    fixer = replace(
        fixer,
        chances=judge.pose,
        least_overlap=evidence.least_overlap,
        expectations=evidence.expectations,
    )

    def queries(sequence: str) -> list[PosedQuery]:
        """The queries of one sequence; it may run in a process of its own."""
        alterations = [build("alteration", name) for name in settings.alterations]
        rankings = (str(settings.rankings), *settings.others)
        folders = (str(settings.scans), str(settings.submaps))
        asked = Queries(sequence, *folders, rankings, alterations)
        return [PosedQuery.of(fix, judge) for fix in asked.fixes(fixer, map_path, settings.k)]

    limits = {belief: verdict.limits(belief) for belief in BELIEFS}
    return Learned(limits, len(evidence.fixes), evidence.blocks, RIGHT_WITHIN, queries)


def learned_level(settings: Settings, sweeps: Sweeps) -> Learned:
    """Draw level sweeps into a grid that is searched for held-out stretches, and for queries."""
    day = LevelDay.learned(sweeps, settings.unseen_share, LevelHeldOut())

    def queries(sequence: str) -> list[PosedQuery]:
        """The queries of one sequence; it may run in a process of its own."""
        name = f"{sequence}.zarr"
        rankings = store.read(settings.rankings / name, schemas.Rankings)
        if len(rankings.cases) > 1:
            raise InputError(
                f"{rankings.path}: altered queries, and level sweeps are localised as driven alone;"
                " leave altered= empty, or poses="
            )
        submaps = store.read(settings.submaps / name, schemas.Submaps)
        scans = store.read(settings.scans / name, schemas.Scans)
        return day.queries(scans, submaps.load("scans"))

    verdict = day.verdict
    limits = {belief: verdict.limits(belief) for belief in BELIEFS}
    evidence = verdict.evidence
    return Learned(
        limits, len(evidence.fixes), evidence.blocks, level_verdict.RIGHT_WITHIN, queries
    )


if __name__ == "__main__":
    main()
