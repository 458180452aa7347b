"""Exports a site's network to ONNX, and measures how near its answers come to torch's.

The result is an ONNX file, or a site that answers through ONNX Runtime.
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
from pipeline.core.errors import ConfigError
from pipeline.core.replacing import replace as replaced
from pipeline.methods.pointnetvlad.netvlad import Describer
from pipeline.methods.pointnetvlad.pointnetvlad import PointNetVlad
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.online import site, site_file
from pipeline.online.compact import with_small_weights, without_notes
from pipeline.online.runtime import CLASSIFIED, INPUT, session

ALIKE = 1e-4
"""Largest difference allowed between scores or descriptors of ONNX Runtime and of torch."""
VIEWS_TRIED = 32
"""Random views that parity is measured on."""


@dataclass(frozen=True)
class Parity:
    """How an exported network compares with torch on `views` random views."""

    views: int
    largest: float
    """Largest difference of scores, or of descriptors."""
    same_first: float
    """Share of views with the same best place, or nearest descriptor."""


class Scores(nn.Module):
    """The network from heights (1, rings, sectors) in metres to scores, features and headings.

    Scores are (1, places), features (1, 64), headings in degrees (1, places).
    """

    def __init__(self, method: Classifier, net: nn.Module) -> None:
        super().__init__()
        self.net = net
        self.method = method

    def forward(self, heights_m: Tensor) -> tuple[Tensor, ...]:
        low = self.method.h_min_m
        high = self.method.h_max_m
        share = (heights_m.clamp(low, high).double() - low) / (high - low)
        predict: Any = type(self.method).predict
        answers: tuple[Tensor, ...] = predict.__wrapped__(
            self.method, self.net, torch.floor(share * 255 + 0.5).long()
        )
        return tuple(answers)


def export(source: Path, out: Path, compact: bool = False) -> str:
    """Write FILE.onnx with its parity beside it, or FILE.site that answers through it.

    `compact` stores weights in 8 bits, and answers may then differ by more than ALIKE.

    Returns what was written, in a line. Raises ConfigError for a method without a network, or an
    ending that says neither.
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
    if parity.largest > ALIKE and not compact:
        raise ConfigError(f"{source}: {comparison}; over {ALIKE:g}, nothing was written")
    if out.suffix == ".site":
        if not isinstance(method, Classifier):
            raise ConfigError(
                f"-o {out}: only sci and sci_ring can answer through ONNX; FILE.onnx holds this "
                "network alone"
            )
        other_arrays = {key: array for key, array in model.items() if not key.startswith(loop.NET)}
        answering = replace(description, growth=None)
        site_file.write(out, site_file.Parts(answering, other_arrays, arrays, data))
    else:
        with replaced(out) as scratch:
            scratch.write_bytes(data)
        parity_numbers = {
            "views": parity.views,
            "largest_difference": parity.largest,
            "same_first": parity.same_first,
        }
        with replaced(out.with_suffix(".parity.json")) as scratch:
            scratch.write_text(
                json.dumps({"site": description.name, **parity_numbers}, indent=1, allow_nan=False)
                + "\n",
                encoding="utf-8",
            )
    return f"{out}: {out.stat().st_size / 1e6:.1f} MB; {comparison}"


def exported(
    method: Any, model: Mapping[str, NDArray[Any]], compact: bool = False
) -> tuple[bytes, Parity]:
    """Export a method's network as an ONNX file's bytes, and measure its parity with torch.

    Raises ConfigError for a method without a network.
    """
    rng = np.random.default_rng(0)
    if isinstance(method, Classifier):
        method = replace(method, precision="f32", threads=1)
        rings, sectors = (int(side) for side in model["image_shape"])
        net = method.network(len(model["place_xy_m"]), rings, sectors)
        loop.fill(net, model)
        module: nn.Module = Scores(method, net)
        views = rng.uniform(0, method.h_max_m, (VIEWS_TRIED, rings, sectors)) * (
            rng.uniform(size=(VIEWS_TRIED, rings, sectors)) < 0.5
        )
        input_name = INPUT
        names = list(CLASSIFIED)
    elif isinstance(method, PointNetVlad):
        module = Describer()
        loop.fill(module, model)
        views = rng.uniform(-1, 1, (VIEWS_TRIED, int(model["points"]), 3))
        input_name = "points"
        names = ["descriptor"]
    else:
        raise ConfigError(
            f"{type(method).__name__}: has no network to export; sci, sci_ring and pointnetvlad "
            "have one"
        )
    inputs = torch.from_numpy(views.astype(np.float32))
    data = _onnx(module.eval(), inputs[:1], input_name, names, compact)
    run = session(data)
    with torch.no_grad(), loop.reproducible(1):
        torch_answers = [_first(module(view[None])) for view in inputs]
    onnx_answers = [_first(run.run(None, {input_name: view[None].numpy()})) for view in inputs]
    largest = max(
        float(np.abs(a - b).max()) for a, b in zip(torch_answers, onnx_answers, strict=True)
    )
    same_first = np.mean(
        [a.argmax() == b.argmax() for a, b in zip(torch_answers, onnx_answers, strict=True)]
    )
    return data, Parity(VIEWS_TRIED, largest, float(same_first))


def _first(answers: Any) -> NDArray[np.float64]:
    """The output that is compared: the scores, or the descriptor."""
    return np.asarray(answers if isinstance(answers, Tensor) else answers[0], np.float64)


def _onnx(
    module: nn.Module, example: Tensor, input_name: str, outputs: list[str], compact: bool
) -> bytes:
    """Export a module as an ONNX file's bytes, without the exporter's own messages."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with (
        torch.no_grad(),
        warnings.catch_warnings(),
        redirect_stdout(StringIO()),
        redirect_stderr(StringIO()),
    ):
        warnings.simplefilter("ignore")
        try:
            program = torch.onnx.export(
                module,
                (example,),
                dynamo=True,
                input_names=[input_name],
                output_names=outputs,
                verbose=False,
            )
        except ImportError as error:
            raise ConfigError(
                f"{error.name}: not installed; `pip install 'yearloc[onnx]'`"
            ) from None
    assert program is not None
    graph = without_notes(program.model_proto)
    return bytes((with_small_weights(graph) if compact else graph).SerializeToString())
