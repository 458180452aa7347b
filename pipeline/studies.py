"""The studies of conf/benchmark.yaml, and the lists that dvc.yaml expands to.

A study is one data set's training sequence, its test sequences, and the cells and methods that are compared on them. Its question
is how a localiser lasts over a `year`; methods that look at bird-views are asked besides how they bear being turned (DOM and PFL,
IROS 2018). A study of `viewpoints` asks that alone, of sequences that share no place with training; then several may train, with
blanks between. DVC can look up no name within another, so all that a stage needs is spelled out once for each drive, view, grid
and method.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.errors import ConfigError

Lists = dict[str, dict[str, dict[str, Any]]]

LISTS = ("drives", "submaps", "views", "birdviews", "labels", "models", "rankings", "reports", "viewpoints", "published")
QUESTIONS = ("year", "viewpoints")
DRIVEN = ("world", "source", "heeds", "root")
"""What the stages of one drive take from its study. `heeds` is what its logs depend on in the data set's yaml: the
reader, or of a simulated one no more than that it is simulated."""


def expand(studies: Mapping[str, Mapping[str, Any]]) -> Lists:
    """For each list the name of a stage's instance, such as campus-10m-sci, to its words."""
    lists: Lists = {name: {} for name in LISTS}
    for dataset, study in studies.items():
        train, trained, year = study["train"], study["train"].split(), asks_about_the_year(study)
        sequences = [*trained, *study["tests"]]
        words = {"dataset": dataset, "train": train}
        learned = {"of": f"/{train}.zarr" if len(trained) == 1 else ""}
        for sequence in sequences:
            own = {name: study[name] for name in DRIVEN}
            lists["drives"][f"{dataset}-{sequence}"] = {"dataset": dataset, "sequence": sequence, **own}
        lists["submaps"][dataset] = {"dataset": dataset, "submap": study["submap"], "sequences": " ".join(sequences)}
        for method in study["methods"]:
            view = {"dataset": dataset, "view": method["view"], "sequences": " ".join(sequences)}
            lists[method.get("stage", "views")][f"{dataset}-{method['view']}"] = view
        for grid in study["grids"]:
            labelled = sequences if year else trained
            lists["labels"][f"{dataset}-{grid}"] = {"grid": grid, **words, "sequences": " ".join(labelled)}
            for method in study["methods"]:
                name, own = f"{dataset}-{grid}-{method['name']}", {"grid": grid, "method": method["name"], "view": method["view"]}
                for model, seed in seeded(method).items():
                    learn = " ".join(word for word in (f"budget={study['budget']}", seed) if word)
                    told = {"model": model, "learn": learn, "budget": study["budget"]}
                    lists["models"][f"{dataset}-{grid}-{model}"] = {**own, **told, **words, **learned}
                if year:
                    lists["rankings"][name] = {**own, **words, "tests": " ".join(study["tests"])}
            if year:
                lists["reports"][f"{dataset}-{grid}"] = {"grid": grid, **words}
            if turned(study["methods"]):
                lists["viewpoints"][f"{dataset}-{grid}"] = {"grid": grid, "dataset": dataset}
        if year:
            lists["published"][dataset] = {**words, "judged": "viewpoints" if turned(study["methods"]) else "evaluate"}
    return lists


def asks_about_the_year(study: Mapping[str, Any]) -> bool:
    """Whether a study's tests show the training sequence's places."""
    if study["question"] not in QUESTIONS:
        raise ConfigError(f"question={study['question']}: expected {' or '.join(QUESTIONS)}")
    return bool(study["question"] == "year")


def seeded(method: Mapping[str, Any]) -> dict[str, str]:
    """The models of a method of a study, one a seed, and what the command that trains each one adds."""
    name = method["name"]
    return {name: ""} | {f"{name}-seed{seed}": f"method.seed={seed}" for seed in range(1, method.get("seeds", 1))}


def turned(methods: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The methods of a study that look at bird-views, which are drawn at all headings."""
    return [method for method in methods if method.get("stage") == "birdviews"]


def spelled_out(benchmark: Mapping[str, Any]) -> Mapping[str, Any]:
    """The studies of a conf/benchmark.yaml; raises ConfigError where its lists are not what they come to."""
    studies: Mapping[str, Any] = benchmark["studies"]
    if any(benchmark.get(name) != members for name, members in expand(studies).items()):
        raise ConfigError("conf/benchmark.yaml: its lists are not those of its studies; `yearloc use` spells them out anew")
    return studies
