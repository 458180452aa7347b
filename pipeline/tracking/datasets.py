"""The sequences that a run was trained and tested on, as MLflow's datasets: a name, a digest, and
what it was used for."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.running.dvc_files import DvcLock

if TYPE_CHECKING:
    from mlflow import MlflowClient

LENGTH = 8  # characters of a digest, as of those that MLflow makes itself: the page shows them all
USED_FOR = "mlflow.data.context"


@dataclass(frozen=True)
class Used:
    """One sequence of a study."""

    name: str  # study and sequence
    digest: str
    context: str  # train or test
    source: str  # its submaps' path inside the project


def used(
    study: str, words: Mapping[str, Any], tests: Sequence[str], lock: DvcLock, train: bool = True
) -> list[Used]:
    """The training sequence, where wanted, and some tests.

    A digest is that of the study's submaps in DVC's lock files with the sequence's name; where they
    record none, that of the study's settings, `words`.
    """
    folder = f"artifacts/submaps/{study}"
    made_of = lock.of(folder)[0] or json.dumps(words, sort_keys=True, default=str)
    roles = {
        **dict.fromkeys(words["train"].split() if train else (), "train"),
        **dict.fromkeys(tests, "test"),
    }
    found = []
    for sequence, context in roles.items():
        digest = hashlib.sha256(f"{made_of} {sequence}".encode()).hexdigest()[:LENGTH]
        found.append(
            Used(
                f"{study} {sequence}", digest, context, Path(folder, f"{sequence}.zarr").as_posix()
            )
        )
    return found


def log(client: "MlflowClient", run_id: str, found: Sequence[Used]) -> None:
    """Add the sequences to a run."""
    from mlflow.entities import Dataset, DatasetInput, InputTag

    inputs = [
        DatasetInput(
            Dataset(one.name, one.digest, "local", json.dumps({"uri": one.source})),
            [InputTag(USED_FOR, one.context)],
        )
        for one in found
    ]
    if inputs:
        client.log_inputs(run_id, inputs)
