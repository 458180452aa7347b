"""Rankings and the map → a pose of each query, its places re-ranked, and whether to believe it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline.core import schemas, store
from pipeline.core.settings import Count, Names, Share
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows
from pipeline.posing.answers import Posing
from pipeline.posing.fix import Fix
from pipeline.posing.held_out import Drive, TrainingDay
from pipeline.posing.queries import Queries
from pipeline.posing.search import Fixer
from pipeline.posing.verdict import Verdict
from stages import EachSequence, ProgressBar, build, stage


@dataclass(frozen=True)
class Budget:
    """What the stage takes of a file of conf/budget."""

    poses: Mapping[str, Any] | None = None
    """Fields of the fixer that have another value."""


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """What the stage is told."""

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


@stage("poses")
def main(settings: Settings) -> str:
    name = f"{settings.train}.zarr"
    labels = store.read(settings.labels / name, schemas.Labels)
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
    with instantiate(settings.compute) as compute, store.replace(settings.out) as folder:
        folder.mkdir()
        evidence = settings.held_out.evidence(fixer, day, compute, ProgressBar())
        verdict = Verdict(evidence, settings.unseen_share)
        posing = Posing(verdict, Places.of(labels), settings.wanted_precision)
        fixer = replace(fixer, chances=verdict.judge.pose, least_overlap=evidence.least_overlap)
        lines = [f"{len(evidence.fixes)} fixes of {evidence.blocks} held-out blocks"]
        sequences = settings.sequences
        fixes_by_sequence = compute.each(
            lambda sequence: fixes(settings, fixer, map_path, sequence), sequences
        )
        for sequence, sequence_fixes in zip(
            sequences,
            ProgressBar().track(fixes_by_sequence, len(sequences), "register"),
            strict=True,
        ):
            rankings = store.read(settings.rankings / f"{sequence}.zarr", schemas.Rankings)
            lines.append(posing.write(folder / f"{sequence}.zarr", rankings, sequence_fixes))
    return "; ".join(lines)


def fixes(settings: Settings, fixer: Fixer, map_path: Path, sequence: str) -> list[Fix]:
    """The fixes of one sequence; it may run in a process of its own."""
    alterations = [build("alteration", name) for name in settings.alterations]
    rankings = (str(settings.rankings), *settings.others)
    folders = (str(settings.scans), str(settings.submaps))
    return Queries(sequence, *folders, rankings, alterations).fixes(fixer, map_path, settings.k)


if __name__ == "__main__":
    main()
