"""Packs a trained model of a study, its map and its verdict into a site file (METHODS 10.1).

1. Read the model and the artifacts of its training day.
2. Thin the day's submaps into a map, unless the map is an artifact already.
3. Read the verdict that the stage `poses` learned from validation blocks of the day, or learn it
   here.
4. Write all of it, with its provenance, into one file.

A model of level sweeps becomes a level site (level_pack.py).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np

from pipeline.core import schemas, store
from pipeline.core.building import build, parsed
from pipeline.core.compute import Compute
from pipeline.core.datum import Datum
from pipeline.core.errors import ConfigError
from pipeline.core.grid import Grid
from pipeline.core.precisions import JUDGED_PRECISION, shown
from pipeline.core.progress import Progress
from pipeline.level.validation import Sweeps
from pipeline.mapping.gathering import submap_points
from pipeline.matching.places import Places
from pipeline.matching.ranking import Model, Rows
from pipeline.matching.rejection import VALIDATION
from pipeline.online import site, site_file
from pipeline.online.level_pack import pack_sweeps
from pipeline.online.sensor import typical
from pipeline.online.site_file import Arrays
from pipeline.online.site_json import (
    Increments,
    LearnedDay,
    MapSettings,
    Provenance,
    Sensor,
    SiteDescription,
)
from pipeline.posing.learned_verdict import VERDICT, Learned, basis
from pipeline.posing.targets import write_map
from pipeline.posing.validation import Drive, TrainingDay, ValidationBlocks
from pipeline.posing.verdict import Verdict
from pipeline.running.dvc_files import DvcLock
from pipeline.running.texts import read_yaml
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study, StudyMethod

VERSIONS = ("numpy", "numba", "torch", "small_gicp", "safetensors")
"""Packages whose versions a site records."""
NOT_PACKED = (VALIDATION, "curves/", "best_epoch")
"""Beginnings of the names of a model's arrays that localisation does not need; they are left out.
"""
SENSOR_SCANS = 9
"""The sensor is described from this many scans, evenly spread over the day."""


@dataclass(frozen=True)
class Trained:
    """A trained model of a study, and the artifacts of the day that it learned."""

    name: str
    """STUDY/GRID/MODEL."""
    simulated: bool
    train: str
    """The sequence that was learned."""
    view: str
    """The method's view: the name of a file of conf/view."""
    model: Path
    labels: Path
    scans: Path
    submaps: Path
    views: Path
    map: Path
    """The day's map; if it is missing, it is made here."""
    verdict: Path | None = None
    """The verdict that the stage `poses` learned; if it is missing, it is learned here."""

    @classmethod
    def of_study(cls, layout: Layout, study: Study, grid: str, model_name: str) -> Self:
        """The model of a study in one of its grids.

        Raises ConfigError for a name that the study does not have, and for a model that matches
        sequences of scans.
        """
        dataset = study.name
        name = f"{dataset}/{grid}/{model_name}"
        if study.map:
            raise ConfigError(
                f"{name}: learned a 3-D map, which is packed without a study: "
                f"`yearloc pack --map {study.map} -o FILE.site`"
            )
        method, variant = _method_and_variant(study, name, model_name)
        train = study.train_text
        view = method.view_of(variant)
        return cls(
            name,
            study.simulated,
            train,
            view,
            layout.path("train", dataset, grid, model_name),
            layout.path("labels", dataset, grid, train),
            layout.path("scans", dataset, train),
            layout.path("submaps", dataset, train),
            layout.path("views", dataset, view, train),
            layout.path("map", dataset, train),
            layout.path("poses", dataset, grid, model_name, VERDICT),
        )

    @property
    def dataset(self) -> str:
        """The name of a file of conf/dataset."""
        return self.name.partition("/")[0]


@dataclass(frozen=True)
class Packing:
    """Packs sites from a project's artifacts, as its conf/ describes them."""

    conf: Path
    """The folder conf/ of the project."""

    def pack(
        self, trained: Trained, out: Path, progress: Progress, datum: Datum | None = None
    ) -> str:
        """Write the site of a model; returns a line on its content.

        `datum` says where its world lies on the Earth, if that is known.

        Raises ConfigError for a model whose submaps gather several scans, ArtifactError if an
        artifact is missing.
        """
        name = trained.name
        labels = store.read(trained.labels, schemas.Labels)
        scans = store.read(trained.scans, schemas.Scans)
        submaps = store.read(trained.submaps, schemas.Submaps)
        reader = read_yaml(self.conf / "dataset" / f"{trained.dataset}.yaml")["reader"]
        is_single = (submaps.load("first") == submaps.load("scans")).all()
        if not is_single and Sweeps.of(scans).is_level:
            return pack_sweeps(
                name,
                out,
                scans,
                trained.train,
                trained.simulated,
                reader,
                progress,
                trained.verdict,
                datum,
            )
        if not is_single:
            raise ConfigError(
                f"{name}: its submaps gather several scans, or sweeps that are not level; a site "
                "localises single scans or level sweeps"
            )

        # the method, and the settings of poses
        view = read_yaml(self.conf / "view" / f"{trained.view}.yaml")
        recipe = {key: parsed(value) for key, value in store.read_recipe(trained.model).items()}
        trained_model = store.read_model(trained.model)
        settings = read_yaml(self.conf / "poses.yaml")
        k = int(settings["k"])
        fixer, validation = (build(settings[key], site.ROOTS) for key in ("fixer", "validation"))
        assert isinstance(validation, ValidationBlocks)

        learned_with = basis(
            trained.model.read_bytes(),
            **{key: settings[key] for key in ("fixer", "validation", "k", "unseen_share")},
        )
        learned = Learned.read(trained.verdict, learned_with)

        # the map, and validation blocks localised in it
        with TemporaryDirectory() as scratch:
            map_path = trained.map
            if not map_path.is_dir():
                map_path = Path(scratch, map_path.name)
                self._write_map(map_path, scans, submaps, progress)
            site_map = store.read(map_path, schemas.Maps)
            views = Rows.read(trained.views)
            if learned is None:
                learned_day = TrainingDay(
                    map_path,
                    Drive(Path(scans.path), Path(submaps.path)),
                    views,
                    labels.load("places"),
                    build(view, site.ROOTS),
                    build(recipe, site.ROOTS).localizer(trained_model),
                    k,
                )
                with Compute("processes") as compute:
                    evidence = validation.evidence(fixer, learned_day, compute, progress)
                learned = Learned.of(evidence, evidence.verdict(settings["unseen_share"]))
            arrays = {key: site_map.load(key) for key in schemas.Maps.columns}

        # the description of the site
        verdict = learned.verdict
        description = SiteDescription(
            name=name,
            simulated=trained.simulated,
            method=recipe,
            view=view,
            fixer=settings["fixer"] | {"least_overlap": learned.least_overlap},
            k=k,
            places=Grid(labels.cell_m, labels.x_m, labels.y_m),
            map=MapSettings(site_map.grain_m, site_map.range_m, site_map.single),
            verdict=verdict,
            reader=reader,
            sensor=self._sensor(scans, submaps, reader),
            provenance=self._provenance(trained),
            incremental_learning=Increments(
                site_map.voxel_m, (LearnedDay(trained.train, len(views.stamps_ns)),)
            ),
            datum=datum,
        )

        # the file
        model = {
            key: array for key, array in trained_model.items() if not key.startswith(NOT_PACKED)
        }
        arrays = {**arrays, "cells": labels.cells, **learned.expectations.arrays}
        arrays |= site.drawn_walls(description, arrays)
        incremental_learning_views = learned_from(views, trained_model)
        site_file.write(
            out, site_file.Parts(description, model, arrays, None, incremental_learning_views)
        )
        places = f"{len(Places.of(labels).cells)} places, {len(arrays['world_T_anchor'])} submaps"
        return (
            f"{out}: {places}, {out.stat().st_size / 1e6:.1f} MB; by {verdict.validation_blocks} "
            f"validation blocks it reaches the {_target_words(description.verdict)}"
        )

    def _write_map(
        self, path: Path, scans: schemas.Scans, submaps: schemas.Submaps, progress: Progress
    ) -> None:
        """Thin the day's submaps into a map artifact, with the lengths of conf/map.yaml."""
        progress.tell(f"thin {submaps['scans'].shape[0]} submaps into a map")
        settings = read_yaml(self.conf / "map.yaml")
        lengths = {key: value for key, value in settings.items() if key.endswith("_m")}
        write_map(path, scans, submaps, **lengths)

    def _provenance(self, trained: Trained) -> Provenance:
        """The provenance of the site: DVC's digests, versions, and the training day."""
        lock = DvcLock.read(self.conf.parent / "dvc.lock")
        parts = {"model": trained.model, "labels": trained.labels, "scans": trained.scans}
        digests = {}
        for part, path in parts.items():
            digests[part], _ = lock.of(path.as_posix())
        return Provenance.of(trained.train, digests, VERSIONS)

    def _sensor(
        self, scans: schemas.Scans, submaps: schemas.Submaps, reader: Mapping[str, Any]
    ) -> Sensor:
        """A description of some training scans, and how far the reader raises them."""
        rows = np.unique(np.linspace(0, len(submaps.scans) - 1, SENSOR_SCANS).astype(int))
        clouds = (next(iter(submap_points(scans, submaps, slice(row, row + 1)))) for row in rows)
        lift_m = float(reader.get("lidar_height_m", reader.get("lift_m", 0.0)))
        return typical(clouds, lift_m)


def _method_and_variant(study: Study, name: str, model_name: str) -> tuple[StudyMethod, str]:
    """The study's entry of a model's method, and the variant.

    Raises ConfigError for a model that the study does not have or that cannot be packed.
    """
    models = {
        model.name: (method, model.variant) for method in study.methods for model in method.models
    }
    if model_name not in models:
        if model_name.removesuffix("-pose") in models:
            raise ConfigError(f"{name}: pack {name.removesuffix('-pose')}; every site makes poses")
        packable = [model for model, (method, _) in models.items() if not method.is_on_bird_views]
        raise ConfigError(f"{name}: no such model to pack, expected one of {', '.join(packable)}")
    method, variant = models[model_name]
    if method.is_on_bird_views:
        raise ConfigError(f"{name}: matches sequences of bird-views; a site localises single scans")
    return method, variant


def _target_words(verdict: Verdict) -> str:
    """Words that say which target precisions a site reaches, which not, and what it keeps of .99.

    The target precisions are ascending, so the reached ones come first.
    """
    reached = verdict.reachable
    tried = verdict.target_precisions
    words = f"target precisions {', '.join(map(shown, reached)) or 'none'}"
    if len(reached) < len(tried):
        words += f", not {', '.join(map(shown, tried[len(reached) :]))}"
    if kept := verdict.kept_words(JUDGED_PRECISION):
        words += f"; {kept}"
    return words


def learned_from(views: Rows, model: Model) -> Arrays:
    """The arrays that a site needs for incremental learning.

    These are the views that its model learned from, the number of the day of each view, the
    probability that its pose is right, and the model's answers to validation views.
    """
    n = len(views.stamps_ns)
    arrays = {
        "images": np.asarray(views.images[:]),
        "stamps_ns": views.stamps_ns,
        "world_T_anchor": views.world_T_anchor,
    }
    arrays |= {"days": np.zeros(n, np.int64), "probabilities": np.ones(n)}
    return arrays | {name: array for name, array in model.items() if name.startswith(VALIDATION)}
