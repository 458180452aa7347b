"""The sequences that a run was trained and tested on, as MLflow's datasets.

In: a study, and what DVC recorded of its submaps. Out: `UsedSequence`s, each with a digest of what
it was made of, which `log` adds to a run.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.running.dvc_files import DvcLock
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study

if TYPE_CHECKING:
    from mlflow import MlflowClient

DIGEST_LENGTH = 8  # characters, as many as MLflow's own have: the page shows them all
USED_FOR = "mlflow.data.context"  # the tag that says what a dataset was used for


@dataclass(frozen=True)
class UsedSequence:
    """One sequence of a study, and whether a run trained or tested on it."""

    name: str  # study and sequence
    digest: str
    context: str  # train or test
    source: str  # its submaps' path inside the project


def used_sequences(
    study: Study, tests: Sequence[str], lock: DvcLock, with_training: bool = True
) -> list[UsedSequence]:
    """The training sequences, if `with_training`, and the test sequences.

    A digest is of the sequence's name and the digest of the study's submaps in DVC's lock files;
    if they record none, of the name and the study's settings.
    """
    folder = Layout().path("submaps", study.name).as_posix()
    made_of = lock.of(folder)[0] or json.dumps(study.table(), sort_keys=True, default=str)
    training = study.train if with_training else ()
    contexts = dict.fromkeys(training, "train") | dict.fromkeys(tests, "test")
    return [
        UsedSequence(
            name=f"{study.name} {sequence}",
            digest=hashlib.sha256(f"{made_of} {sequence}".encode()).hexdigest()[:DIGEST_LENGTH],
            context=context,
            source=Layout().path("submaps", study.name, sequence).as_posix(),
        )
        for sequence, context in contexts.items()
    ]


def log(client: "MlflowClient", run_id: str, sequences: Sequence[UsedSequence]) -> None:
    """Add the sequences to a run."""
    from mlflow.entities import Dataset, DatasetInput, InputTag

    inputs = [
        DatasetInput(
            Dataset(sequence.name, sequence.digest, "local", json.dumps({"uri": sequence.source})),
            [InputTag(USED_FOR, sequence.context)],
        )
        for sequence in sequences
    ]
    if inputs:
        client.log_inputs(run_id, inputs)
