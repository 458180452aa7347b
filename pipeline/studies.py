"""The studies of conf/benchmark.yaml, and the lists that dvc.yaml expands to.

A study is one data set's training sequence, its test sequences, and the cells and methods that are compared on them. DVC can look
up no name within another, so all that a stage needs to know is spelled out once for each drive, view, grid and method.
"""

from collections.abc import Mapping
from typing import Any

from pipeline.errors import ConfigError

Lists = dict[str, dict[str, dict[str, Any]]]

DRIVEN = ("world", "source", "heeds", "root")
"""What the stages of one drive take from its study. `heeds` is what its logs depend on in the data set's yaml: the
reader, or of a simulated one no more than that it is simulated."""


def expand(studies: Mapping[str, Mapping[str, Any]]) -> Lists:
    """For each list the name of a stage's instance, such as campus-10m-sci, to its words."""
    lists: Lists = {name: {} for name in ("drives", "submaps", "views", "labels", "models", "reports")}
    for dataset, study in studies.items():
        train, sequences = study["train"], [study["train"], *study["tests"]]
        words = {"dataset": dataset, "train": train}
        for sequence in sequences:
            own = {name: study[name] for name in DRIVEN}
            lists["drives"][f"{dataset}-{sequence}"] = {"dataset": dataset, "sequence": sequence, **own}
        lists["submaps"][dataset] = {"dataset": dataset, "submap": study["submap"], "sequences": " ".join(sequences)}
        for view in dict.fromkeys(method["view"] for method in study["methods"]):
            lists["views"][f"{dataset}-{view}"] = {"dataset": dataset, "view": view, "sequences": " ".join(sequences)}
        for grid in study["grids"]:
            lists["reports"][f"{dataset}-{grid}"] = {"grid": grid, **words}
            lists["labels"][f"{dataset}-{grid}"] = {"grid": grid, **words, "sequences": " ".join(sequences)}
            for method in study["methods"]:
                own = {"grid": grid, "method": method["name"], "view": method["view"], "budget": study["budget"]}
                lists["models"][f"{dataset}-{grid}-{method['name']}"] = {**own, **words, "tests": " ".join(study["tests"])}
    return lists


def spelled_out(benchmark: Mapping[str, Any]) -> Mapping[str, Any]:
    """The studies of a conf/benchmark.yaml; raises ConfigError where its lists are not what they come to."""
    studies: Mapping[str, Any] = benchmark["studies"]
    if any(benchmark.get(name) != members for name, members in expand(studies).items()):
        raise ConfigError("conf/benchmark.yaml: its lists are not those of its studies; `yearloc use` spells them out anew")
    return studies
