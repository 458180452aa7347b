"""Ranks places by a network of `sci` or `sci_ring` without torch, so that a site opens fast.

The network is either exported and run by ONNX Runtime (`exported`), or computed in NumPy
(networks/plain.py). `localizer` turns its answers into rankings, as the methods do (METHODS 2.6 and
8).
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from pipeline.matching.ranking import Localizer, Ranking, Rows
from pipeline.matching.return_profiles import ReturnProfiles, reranked, return_profiles

NETWORK = "network.onnx"
"""The name of an exported network in a site file."""
INPUT = "heights_m"
CLASSIFIED = ("scores", "features", "heading_deg")
"""The names of an exported network's input and outputs."""
Network = Callable[[NDArray[np.float32]], tuple[NDArray[np.float32], ...]]
"""Takes heights (rings, sectors) in metres; returns scores (places,), features (64,) and headings
(places,) in degrees."""


def session(data: bytes, threads: int = 1) -> Any:
    """Open an ONNX Runtime session of a file's bytes, on the processor."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])


def exported(data: bytes, threads: int) -> Network:
    """The network in the bytes of an ONNX file."""
    run = session(data, threads)

    def answer(heights_m: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
        outputs = run.run(list(CLASSIFIED), {INPUT: heights_m[None]})
        return tuple(output[0] for output in outputs)

    return answer


def localizer(network: Network, model: Mapping[str, NDArray[Any]]) -> Localizer:
    """A localizer that ranks the k places of the highest softmax of a network's scores.

    The novelty of a query is one minus the highest softmax. A network with headings is of
    `sci_ring`: its first answer has the position of the training view with the most similar
    features.
    """
    place_xy_m = model["place_xy_m"]
    training_return_profiles = ReturnProfiles.of(model) if ReturnProfiles.is_in(model) else None

    def localize(views: Rows, k: int) -> Ranking:
        answers = [network(np.asarray(image, np.float32)) for image in views.images]
        scores, features, heading_deg = (np.stack(parts) for parts in zip(*answers, strict=True))
        if training_return_profiles:
            scores, heading_deg = reranked(
                scores.astype(np.float64),
                heading_deg,
                return_profiles(views.images),
                training_return_profiles,
            )
        probabilities = softmax(scores.astype(np.float64), axis=1)
        places = np.argsort(-probabilities, axis=1, kind="stable")[:, :k]
        headings = np.take_along_axis(heading_deg, places, axis=1).astype(np.float32)
        xy_m = place_xy_m[places]
        if np.isfinite(headings).all():
            xy_m[:, 0] = model["memory_xy_m"][(features @ model["memory"].T).argmax(axis=1)]
        # (query, k); costs and novelty are one minus a probability
        place_probabilities = np.take_along_axis(probabilities, places, axis=1)
        costs = (1 - place_probabilities).astype(np.float32)
        novelty = (1 - place_probabilities[:, :1]).astype(np.float32)
        confidence = place_probabilities[:, 0].astype(np.float32)
        return Ranking(places, costs, xy_m, novelty, confidence, headings, ("probability",))

    return localize
