"""Exports a site's network to ONNX, and checks its answers against torch's (METHODS 10.4).

The result is an ONNX file of the network, or a site that answers through ONNX Runtime. The two
networks are compared on random views; if their answers differ by more than SIMILAR_WITHIN, nothing
is written.
"""

import json
import logging
import warnings
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.core.building import build
from pipeline.core.errors import ConfigError, needed
from pipeline.core.replacing import replace as replaced
from pipeline.core.replacing import write_text
from pipeline.methods.pointnetvlad.netvlad import Describer
from pipeline.methods.pointnetvlad.pointnetvlad import PointNetVlad
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.plain import NET
from pipeline.online import site, site_file
from pipeline.online.runtime import CLASSIFIED, INPUT, session

SIMILAR_WITHIN = 1e-4
"""Scores or descriptors of ONNX Runtime may differ from torch's by this."""
VIEWS_TRIED = 32
"""The number of random views on which the two networks are compared."""
LEAST_WEIGHTS = 1000
"""Arrays of fewer weights are not stored in 8 bits."""
MOST_STEPS = 127
"""The largest weight of a row, in 8-bit steps."""


@dataclass(frozen=True)
class Parity:
    """How an exported network compares with torch on `views` random views."""

    views: int
    largest: float
    """The largest difference between scores, or between numbers of descriptors."""
    same_first: float
    """The share of views for which both networks give the same place the highest score, or have the
    largest number of the descriptor at the same index."""


@dataclass(frozen=True)
class Exportable:
    """A method's network, ready to be exported."""

    module: nn.Module
    views: NDArray[np.float64]
    """(VIEWS_TRIED, …) random views to compare the networks on."""
    input_name: str
    output_names: list[str]
    """The first output is compared."""


class Scores(nn.Module):
    """A network of SCI, from heights (1, rings, sectors) in metres to the answers of CLASSIFIED.

    These are scores (1, places), features (1, 64), and headings (1, places) in degrees. Heights are
    clipped and quantised to 256 steps in this module, so that the exported file does it too.
    """

    def __init__(self, method: Classifier, net: nn.Module) -> None:
        super().__init__()
        self.net = net
        self.method = method

    def forward(self, heights_m: Tensor) -> tuple[Tensor, ...]:
        """Quantise the heights as the method does, and answer with its network."""
        low = self.method.h_min_m
        high = self.method.h_max_m
        share = (heights_m.clamp(low, high).double() - low) / (high - low)
        predict: Any = type(self.method).predict
        answers: tuple[Tensor, ...] = predict.__wrapped__(
            self.method, self.net, torch.floor(share * 255 + 0.5).long()
        )
        return tuple(answers)


def export(source: Path, out: Path, compact: bool = False) -> str:
    """Write the network of the site `source` as FILE.onnx, or as a FILE.site that runs it.

    FILE.parity.json is written beside FILE.onnx. `compact` stores weights in 8 bits; answers may
    then differ by more than SIMILAR_WITHIN. Returns a line on what was written. Raises ConfigError
    for a method without a network, another ending of `out`, or answers that differ too much.
    """
    description, model, arrays, network, _ = site_file.read(source)
    if out.suffix not in (".onnx", ".site"):
        raise ConfigError(f"-o {out}: expected FILE.onnx or FILE.site")
    if network is not None:
        raise ConfigError(f"{source}: is exported already; export the site that it came from")
    method = build(description.method, site.ROOTS)
    data, parity = exported(method, model, compact)
    comparison = (
        f"on {parity.views} views {parity.largest:.1e} off torch at most, {parity.same_first:.0%} "
        "with the same best place"
    )
    if parity.largest > SIMILAR_WITHIN and not compact:
        raise ConfigError(f"{source}: {comparison}; over {SIMILAR_WITHIN:g}, nothing was written")
    if out.suffix == ".site":
        if not isinstance(method, Classifier):
            raise ConfigError(
                f"-o {out}: only sci and sci_ring can answer through ONNX; FILE.onnx holds this "
                "network alone"
            )
        other_arrays = {key: array for key, array in model.items() if not key.startswith(NET)}
        exported_description = replace(description, incremental_learning=None)
        site_file.write(out, site_file.Parts(exported_description, other_arrays, arrays, data))
    else:
        with replaced(out) as scratch:
            scratch.write_bytes(data)
        parity_numbers = {
            "views": parity.views,
            "largest_difference": parity.largest,
            "same_first": parity.same_first,
        }
        content = {"site": description.name, **parity_numbers}
        text = json.dumps(content, indent=1, allow_nan=False)
        write_text(out.with_suffix(".parity.json"), f"{text}\n")
    return f"{out}: {out.stat().st_size / 1e6:.1f} MB; {comparison}"


def exported(
    method: Any, model: Mapping[str, NDArray[Any]], compact: bool = False
) -> tuple[bytes, Parity]:
    """Export a method's network as an ONNX file's bytes, and measure its parity with torch.

    Raises ConfigError for a method without a network.
    """
    exportable = _exportable(method, model)
    module = exportable.module.eval()
    views = torch.from_numpy(exportable.views.astype(np.float32))
    data = _onnx(module, views[:1], exportable.input_name, exportable.output_names, compact)
    run = session(data)
    differences = []
    are_same = []
    for view in views:
        with torch.no_grad(), loop.reproducible(1):
            by_torch = _first(module(view[None]))
        by_onnx = _first(run.run(None, {exportable.input_name: view[None].numpy()}))
        differences.append(float(np.abs(by_torch - by_onnx).max()))
        are_same.append(by_torch.argmax() == by_onnx.argmax())
    return data, Parity(VIEWS_TRIED, max(differences), float(np.mean(are_same)))


def _exportable(method: Any, model: Mapping[str, NDArray[Any]]) -> Exportable:
    """The network of a method with its trained weights; raises ConfigError if it has none."""
    rng = np.random.default_rng(0)
    if isinstance(method, Classifier):
        method = replace(method, precision="f32", threads=1)
        rings, sectors = (int(side) for side in model["image_shape"])
        net = method.network(len(model["place_xy_m"]), rings, sectors)
        loop.fill(net, model)
        shape = (VIEWS_TRIED, rings, sectors)
        heights_m = rng.uniform(0, method.h_max_m, shape)
        is_filled = rng.uniform(size=shape) < 0.5
        return Exportable(Scores(method, net), heights_m * is_filled, INPUT, list(CLASSIFIED))
    if isinstance(method, PointNetVlad):
        describer = Describer()
        loop.fill(describer, model)
        points = rng.uniform(-1, 1, (VIEWS_TRIED, int(model["points"]), 3))
        return Exportable(describer, points, "points", ["descriptor"])
    raise ConfigError(
        f"{type(method).__name__}: has no network to export; sci, sci_ring and pointnetvlad "
        "have one"
    )


def _first(answers: Any) -> NDArray[np.float64]:
    """The first output of a network, which is compared: the scores, or the descriptor."""
    return np.asarray(answers if isinstance(answers, Tensor) else answers[0], np.float64)


def _onnx(
    module: nn.Module, example: Tensor, input_name: str, outputs: list[str], compact: bool
) -> bytes:
    """Export a module as an ONNX file's bytes, silencing the exporter's own messages."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with (
        needed("onnx"),
        torch.no_grad(),
        warnings.catch_warnings(),
        redirect_stdout(StringIO()),
        redirect_stderr(StringIO()),
    ):
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            module,
            (example,),
            dynamo=True,
            input_names=[input_name],
            output_names=outputs,
            verbose=False,
        )
    assert program is not None
    proto = _without_notes(program.model_proto)
    if compact:
        proto = _with_small_weights(proto)
    return bytes(proto.SerializeToString())


def _without_notes(model: Any) -> Any:
    """Remove the notes in an onnx.ModelProto on the code and folders that it was exported from.

    The model's bytes then do not depend on the project's folder. Changes the model in place, and
    returns it.
    """
    model.ClearField("metadata_props")
    graph = model.graph
    graph.ClearField("metadata_props")
    for entries in (graph.node, graph.initializer, graph.value_info, graph.input, graph.output):
        for entry in entries:
            entry.ClearField("metadata_props")
            entry.ClearField("doc_string")
    return model


def _with_small_weights(model: Any) -> Any:
    """Store the large float32 weights of an onnx.ModelProto as 8-bit integers.

    Each row along the first axis becomes integers up to MOST_STEPS with a scale of its own, which a
    node DequantizeLinear multiplies again. Changes the model in place, and returns it.
    """
    from onnx import helper, numpy_helper

    graph = model.graph
    for weights in list(graph.initializer):
        values = numpy_helper.to_array(weights)
        if values.dtype != np.float32 or values.size < LEAST_WEIGHTS:
            continue
        rows = values.reshape(len(values), -1)
        scale = np.maximum(np.abs(rows).max(axis=1), np.finfo(np.float32).tiny) / MOST_STEPS
        steps = np.rint(rows / scale[:, None]).astype(np.int8).reshape(values.shape)
        name = weights.name
        graph.initializer.remove(weights)
        graph.initializer.append(numpy_helper.from_array(steps, f"{name}_steps"))
        graph.initializer.append(numpy_helper.from_array(scale.astype(np.float32), f"{name}_scale"))
        inputs = [f"{name}_steps", f"{name}_scale"]
        graph.node.insert(0, helper.make_node("DequantizeLinear", inputs, [name], axis=0))
    return model
