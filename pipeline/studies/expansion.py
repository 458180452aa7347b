"""The studies of conf/benchmark.yaml, and the lists that dvc.yaml expands to.

A study is one data set's training sequence, its test sequences, and the cells and methods that are compared on them. Its question
is how a localiser lasts over a `year`; methods that look at bird-views are asked besides how they bear being turned (DOM and PFL,
IROS 2018). A study of `robustness` asks besides what becomes of altered queries, of sequences of `stress`, of other cells and of
variants of the methods. A study of `viewpoints` asks about turned robots alone, of sequences that share no place with training;
then several may train, with blanks between. DVC can look up no name within another, so all that a stage needs is spelled out once
for each drive, view, grid and method.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.errors import ConfigError

Lists = dict[str, dict[str, dict[str, Any]]]

LISTS = (
    "drives", "submaps", "views", "birdviews", "labels", "models", "rankings", "events", "reports", "viewpoints", "robustness",
    "cells", "published",
)  # fmt: skip
QUESTIONS = ("year", "robustness", "viewpoints")
DRIVEN = ("world", "source", "heeds", "root")
"""What the stages of one drive take from its study. `heeds` is what its logs depend on in the data set's yaml: the
reader, or of a simulated one no more than that it is simulated."""
AS_DRIVEN = "as_driven"
"""The alteration that changes nothing, which the sequences of stress are asked with."""

STRUCTURE = ("demolition", "construction")
"""Alterations that a method's own model is asked about alone: variants differ in the headings that they learned."""


def expand(studies: Mapping[str, Mapping[str, Any]]) -> Lists:
    """For each list the name of a stage's instance, such as campus-10m-sci, to its words."""
    lists: Lists = {name: {} for name in LISTS}
    for dataset, study in studies.items():
        _drawn(lists, dataset, study)
        _learned(lists, dataset, study)
        _told(lists, dataset, study)
    return lists


def _drawn(lists: Lists, dataset: str, study: Mapping[str, Any]) -> None:
    """What is made of the sequences before anything is learned."""
    sequences = [*study["train"].split(), *study["tests"], *study.get("stress", {})]
    driven = {name: study[name] for name in DRIVEN}
    for sequence in sequences:
        lists["drives"][f"{dataset}-{sequence}"] = {"dataset": dataset, "sequence": sequence, **driven}
    lists["submaps"][dataset] = {"dataset": dataset, "submap": study["submap"], "sequences": " ".join(sequences)}
    for method in study["methods"]:
        view = {"dataset": dataset, "view": method["view"], "sequences": " ".join(sequences)}
        lists[method.get("stage", "views")][f"{dataset}-{method['view']}"] = view
    labelled = sequences if asks_about_the_year(study) else study["train"].split()
    for grid in (*study["grids"], *study.get("cells", ())):
        words = {"grid": grid, "dataset": dataset, "train": study["train"], "sequences": " ".join(labelled)}
        lists["labels"][f"{dataset}-{grid}"] = words


def _learned(lists: Lists, dataset: str, study: Mapping[str, Any]) -> None:
    """Models and what they answer: of the further cells no more than each method's own."""
    trained, year = study["train"].split(), asks_about_the_year(study)
    words = {"dataset": dataset, "train": study["train"]}
    learned = {"of": f"/{study['train']}.zarr" if len(trained) == 1 else ""}
    for grid in (*study["grids"], *study.get("cells", ())):
        for method in study["methods"]:
            own = {"grid": grid, "method": method["name"], "code": method["code"], "view": method["view"]}
            for model, changed in models(method).items():
                if grid in study["grids"] or model == method["name"]:
                    learn = " ".join(word for word in (f"budget={study['budget']}", changed) if word)
                    told = {"model": model, "learn": learn, "budget": study["budget"]}
                    lists["models"][f"{dataset}-{grid}-{model}"] = {**own, **told, **words, **learned}
            if year:
                tests = {"tests": " ".join(study["tests"])}
                lists["rankings"][f"{dataset}-{grid}-{method['name']}"] = {**own, **words, **tests}


def _told(lists: Lists, dataset: str, study: Mapping[str, Any]) -> None:
    """What is told of the answers."""
    year, bird_views = asks_about_the_year(study), bool(turned(study["methods"]))
    robust = study.get("question") == "robustness"
    for grid in study["grids"]:
        if year:
            words = {"grid": grid, "dataset": dataset, "train": study["train"]}
            lists["reports"][f"{dataset}-{grid}"] = {**words, "changes": "events" if robust else "evaluate"}
        if bird_views:
            lists["viewpoints"][f"{dataset}-{grid}"] = {"grid": grid, "dataset": dataset}
        for alteration, sequences in study.get("robustness", {}).items():
            words = {"grid": grid, "dataset": dataset, "alteration": alteration, "sequences": " ".join(sequences)}
            words["models"] = "own" if alteration in STRUCTURE else "all"
            lists["robustness"][f"{dataset}-{grid}-{alteration}"] = words
    if study.get("cells"):
        lists["cells"][dataset] = {"dataset": dataset}
    if robust:
        driven = {name: study[name] for name in DRIVEN}
        lists["events"][dataset] = {"dataset": dataset, **driven, "train": study["train"], "sequences": " ".join(study["tests"])}
    if year:
        judged = "viewpoints" if bird_views else "evaluate"
        lists["published"][dataset] = {"dataset": dataset, "train": study["train"], "judged": judged}


def asks_about_the_year(study: Mapping[str, Any]) -> bool:
    """Whether a study's tests show the training sequence's places."""
    question = study.get("question", QUESTIONS[0])
    if question not in QUESTIONS:
        raise ConfigError(f"question={question}: expected {', '.join(QUESTIONS[:-1])} or {QUESTIONS[-1]}")
    return bool(question != "viewpoints")


def models(method: Mapping[str, Any]) -> dict[str, str]:
    """The models of a method of a study, and what the command that trains each one adds: variants of it, each with every seed."""
    variants = {method["name"]: ""} | {f"{method['name']}-{name}": words for name, words in method.get("variants", {}).items()}
    seeds = {f"-seed{seed}": f"method.seed={seed}" for seed in range(1, method.get("seeds", 1))}
    return {
        model + seed: " ".join(word for word in (words, seeding) if word)
        for model, words in variants.items()
        for seed, seeding in ({"": ""} | seeds).items()
    }


def families(methods: Sequence[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Each method and each variant of one to its models, which differ by chance alone."""
    return {
        name: [model for model in models(method) if model == name or model.startswith(f"{name}-seed")]
        for method in methods
        for name in models({**method, "seeds": 1})
    }


def seeded(method: Mapping[str, Any]) -> list[str]:
    """The models of a method that differ by chance alone."""
    return list(models({**method, "variants": {}}))


def turned(methods: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The methods of a study that look at bird-views, which are drawn at all headings."""
    return [method for method in methods if method.get("stage") == "birdviews"]


def spelled_out(benchmark: Mapping[str, Any]) -> Mapping[str, Any]:
    """The studies of a conf/benchmark.yaml; raises ConfigError where its lists are not what they come to."""
    studies: Mapping[str, Any] = benchmark["studies"]
    if any(benchmark.get(name) != members for name, members in expand(studies).items()):
        raise ConfigError("conf/benchmark.yaml: its lists are not those of its studies; `yearloc use` spells them out anew")
    return studies
