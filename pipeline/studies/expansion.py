"""Expands conf/studies.yaml to the lists of dvc.yaml, one entry an instance of a stage.

A study is one data set's training sequence, its test sequences, and the cells and methods that are
compared on them. Its question is how a localiser lasts over a `year`; methods on bird-views are
judged with turned robots besides (DOM and PFL, IROS 2018). A study of `robustness` judges also
altered queries, sequences of `stress`, other cells and variants of the methods. A study of
`viewpoints` judges turned robots alone, on sequences that share no place with training; then
several may train, with blanks between. A study of `lifelong` judges what a model answers after it
learned further days (studies.courses). DVC can look up no name within another, so all that a stage
needs is listed for each of its instances.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from pipeline.errors import ConfigError
from pipeline.studies.courses import LIFELONG, instances

Lists = dict[str, dict[str, dict[str, Any]]]
Study = Mapping[str, Any]

LISTS = (
    "drives",
    "submaps",
    "views",
    "birdviews",
    "altered",
    "labels",
    "maps",
    "models",
    "rankings",
    "poses",
    "paths",
    "evaluations",
    "events",
    "viewpoints",
    "lifelong",
    "latency",
    "results",
    "report",
    "published",
)
QUESTIONS = ("year", "robustness", "viewpoints", LIFELONG)
DRIVE = ("world", "source", "heeds", "root")
"""What the stages of one drive take from its study.

`heeds` is what its logs depend on in the data set's yaml: the reader, or of a simulated one no more
than that it is simulated.
"""
STRUCTURE = ("demolition", "construction")
"""Alterations that a method's own model answers alone: variants and seeds differ in the headings
that they learned."""
TOLERANCE = "15m"
"""How near an answer must be, where a study says nothing: a file of conf/tolerance."""
INSTEAD = {
    "evaluated": "pipeline/__init__.py",
    "viewed": "pipeline/evaluation/__init__.py",
    "changed": "pipeline/formats/__init__.py",
    "learned": "pipeline/fetching/__init__.py",
}
"""What a stage depends on where a study has no such artifact, an empty file: DVC has no optional
dependencies."""


@dataclass(frozen=True)
class ModelName:
    """Identifies a model in the results table: method, variant, seed, whether it was posed."""

    method: str
    variant: str = ""
    seed: int = 0
    posed: bool = False  # its answers were registered, which makes them a variant of their own
    # a file of conf/path: how the poses of a drive were joined, which makes them a further variant
    path: str = ""

    @property
    def family(self) -> str:
        """A method or a variant of one, whatever the seed: `sci-4way`, `sci-4way-pose`."""
        return f"{self.method}-{self.answered}" if self.answered else self.method

    @property
    def answered(self) -> str:
        """The variant as the table of results has it: `4way-pose`, `pose-filter`."""
        return "-".join(filter(None, (self.variant, "pose" * self.posed, self.path)))

    @property
    def name(self) -> str:
        """The name of its artifacts: `sci-4way-seed1`."""
        return f"{self.family}-seed{self.seed}" if self.seed else self.family

    @property
    def columns(self) -> dict[str, Any]:  # of the table of results
        return {"method": self.method, "variant": self.answered, "seed": self.seed}


def expand(studies: Mapping[str, Study]) -> Lists:
    """The entries of each list, by the name of a stage's instance, such as campus-10m-sci."""
    lists: Lists = {name: {} for name in LISTS}
    for dataset, study in studies.items():
        _views(lists, dataset, study)
        for grid, method in product(grids(study), study["methods"]):
            for model in models_of(method):
                if grid in study["grids"] or model == ModelName(method["name"]):
                    _model(lists, dataset, study, grid, method, model)
        _measurements(lists, dataset, study)
    lists["report"]["all"] = {
        "evaluated": "artifacts/evaluate" if lists["rankings"] else INSTEAD["evaluated"],
        "viewed": "artifacts/viewpoints" if lists["viewpoints"] else INSTEAD["viewed"],
        "learned": "artifacts/lifelong" if lists["lifelong"] else INSTEAD["learned"],
        "timed": "artifacts/latency" if lists["latency"] else INSTEAD["changed"],
    }
    return lists


def _views(lists: Lists, dataset: str, study: Study) -> None:
    """Add what is computed before training: logs, scans, submaps, views, labels."""
    sequences = [
        *study["train"].split(),
        *study["tests"],
        *study.get("stress", {}),
        *study.get("learned", ()),
    ]
    sequences += study.get("updates", ())
    drive = {name: study[name] for name in DRIVE}
    all_sequences = " ".join(sequences)
    for sequence in sequences:
        lists["drives"][f"{dataset}-{sequence}"] = {
            "dataset": dataset,
            "sequence": sequence,
            **drive,
        }
    lists["submaps"][dataset] = {
        "dataset": dataset,
        "submap": study["submap"],
        "sequences": all_sequences,
    }
    for method in study["methods"]:
        name = f"{dataset}-{method['view']}"
        view = {"dataset": dataset, "view": method["view"]}
        lists[method.get("stage", "views")][name] = view | {"sequences": all_sequences}
        for alteration, altered_sequences in study.get("altered", {}).items():
            lists["altered"][f"{name}-{alteration}"] = view | {
                "alteration": alteration,
                "sequences": " ".join(altered_sequences),
            }
    labelled = all_sequences if asks_about_the_year(study) else study["train"]
    for grid in grids(study):
        entry = {"grid": grid, "dataset": dataset, "train": study["train"], "sequences": labelled}
        lists["labels"][f"{dataset}-{grid}"] = entry


def _model(
    lists: Lists, dataset: str, study: Study, grid: str, method: Mapping[str, Any], model: ModelName
) -> None:
    """Add the training of a model, its rankings, evaluations, poses and paths."""
    seed = f"method.seed={model.seed}" if model.seed else ""
    settings = " ".join(
        f"method.{name}={value}" for name, value in method.get("settings", {}).items()
    )
    words = (
        f"method={model.method}",
        settings,
        method.get("variants", {}).get(model.variant, ""),
        seed,
    )
    entry = {"dataset": dataset, "grid": grid, "method": model.method, "model": model.name}
    entry |= {
        "recipe": " ".join(filter(None, words)),
        "code": method["code"],
        "view": method["view"],
        "train": study["train"],
    }
    tolerance = {"tolerance": study.get("tolerance", TOLERANCE)}
    learned = {
        "budget": study["budget"],
        "of": "" if " " in study["train"] else f"/{study['train']}.zarr",
    }
    lists["models"][f"{dataset}-{grid}-{model.name}"] = entry | learned
    if study.get("question") == LIFELONG:
        lists["lifelong"] |= instances({**entry, **learned, **tolerance}, study, method, INSTEAD)
    if not asks_about_the_year(study):
        return
    is_own_grid = grid in study["grids"]
    altered = [
        name
        for name in study.get("altered", {})
        if is_own_grid and (name not in STRUCTURE or model == ModelName(model.method))
    ]
    tests = [*study["tests"], *(study.get("stress", {}) if is_own_grid else ())]
    altered_views = (
        f"artifacts/altered/{dataset}/{method['view']}" if altered else INSTEAD["evaluated"]
    )
    queries = {"tests": " ".join(tests), "alterations": " ".join(altered), "altered": altered_views}
    lists["rankings"][f"{dataset}-{grid}-{model.name}"] = entry | queries
    evaluated = {name: entry[name] for name in ("dataset", "grid", "train")} | {
        "tests": queries["tests"],
        **tolerance,
    }
    for answers in answers_of(study, model) if is_own_grid else [model]:
        rankings = f"artifacts/{folder(dataset, grid, answers)}"
        lists["evaluations"][f"{dataset}-{grid}-{answers.name}"] = evaluated | {
            "model": answers.name,
            "rankings": rankings,
        }
        if answers.path:
            followed = {name: entry[name] for name in ("dataset", "grid", "model", "train")} | {
                "path": answers.path
            }
            lists["paths"][f"{dataset}-{grid}-{answers.name}"] = followed | {
                "out": answers.name,
                "tests": queries["tests"],
            }
        elif answers.posed:
            lists["maps"][dataset] = {"dataset": dataset, "train": study["train"]}
            lists["poses"][f"{dataset}-{grid}-{model.name}"] = entry | {
                **{name: queries[name] for name in ("tests", "alterations")},
                "budget": study["budget"],
            }


def _measurements(lists: Lists, dataset: str, study: Study) -> None:
    """Add timings, viewpoints and events, and the results that gather all numbers."""
    year = asks_about_the_year(study)
    robust = study.get("question") == "robustness"
    lifelong = study.get("question") == LIFELONG
    bird_views = bool(on_bird_views(study["methods"])) and not lifelong
    by_grid = {f"{dataset}-{grid}": {"grid": grid, "dataset": dataset} for grid in study["grids"]}
    lists["latency"] |= by_grid if year and is_timed(study) else {}
    lists["viewpoints"] |= by_grid if bird_views else {}
    if robust:
        entry = {"dataset": dataset, "train": study["train"], "sequences": " ".join(study["tests"])}
        lists["events"][dataset] = entry | {name: study[name] for name in DRIVE}
    sources = {
        "evaluated": ("evaluate", year),
        "viewed": ("viewpoints", bird_views),
        "changed": ("events", robust),
        "learned": ("lifelong", lifelong),
    }
    dependencies = {
        word: f"artifacts/{kind}/{dataset}" if exists else INSTEAD[word]
        for word, (kind, exists) in sources.items()
    }
    lists["results"][dataset] = {"dataset": dataset, **dependencies}
    if year or lifelong:
        lists["published"][dataset] = {"dataset": dataset}


def asks_about_the_year(study: Study) -> bool:
    """Whether a study's tests show the training sequence's places."""
    question = study.get("question", QUESTIONS[0])
    if question not in QUESTIONS:
        raise ConfigError(
            f"question={question}: expected {', '.join(QUESTIONS[:-1])} or {QUESTIONS[-1]}"
        )
    return question in QUESTIONS[:2]


def is_timed(study: Study) -> bool:
    """Whether the study measures the cost of a query; it does unless it says no."""
    return bool(study.get("latency", True))


def grids(study: Study) -> tuple[str, ...]:
    """The study's own cell sizes, and those of its study of cell sizes."""
    return (*study["grids"], *study.get("cells", ()))


def models_of(method: Mapping[str, Any]) -> list[ModelName]:
    """The models of a method of a study: its own, then its variants, each with every seed."""
    seeds = range(method.get("seeds", 1))
    return [
        ModelName(method["name"], variant, seed)
        for variant in ("", *method.get("variants", {}))
        for seed in seeds
    ]


def model_named(study: Study, name: str) -> ModelName:
    """The model of a study whose artifacts have this name."""
    return next(
        model for method in study["methods"] for model in models_of(method) if model.name == name
    )


def answers_of(study: Study, model: ModelName) -> list[ModelName]:
    """A model's own answers, those with poses if the study has them, and those along each path."""
    if model.family not in study.get("poses", ()):
        return [model]
    posed = replace(model, posed=True)
    return [model, posed, *(replace(posed, path=path) for path in study.get("paths", ()))]


def folder(dataset: str, grid: str, answers: ModelName) -> str:
    """Where rankings or poses lie, below artifacts/."""
    if answers.path:
        return f"paths/{dataset}/{grid}/{answers.name}"
    kind = "poses" if answers.posed else "localize"
    return f"{kind}/{dataset}/{grid}/{replace(answers, posed=False).name}"


def answerers(study: Study) -> list[ModelName]:
    """All answers at the study's own cell sizes: of each model, with poses and paths too."""
    models = (model for method in study["methods"] for model in models_of(method))
    return [answers for model in models for answers in answers_of(study, model)]


def on_bird_views(methods: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The methods of a study that look at bird-views, which are drawn at all headings."""
    return [method for method in methods if method.get("stage") == "birdviews"]
