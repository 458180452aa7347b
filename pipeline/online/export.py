"""A site's network as an ONNX file, or as a site that answers through ONNX Runtime, with how near
it comes to torch's answers."""

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

from pipeline.errors import ConfigError
from pipeline.methods.pointnetvlad.netvlad import Describer
from pipeline.methods.pointnetvlad.pointnetvlad import PointNetVlad
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.online import site, site_file
from pipeline.online.runtime import CLASSIFIED, INPUT, session
from pipeline.replacing import replace as replaced
from pipeline.running.building import build

ALIKE = 1e-4
"""Scores and descriptors of ONNX Runtime may differ so much from torch's."""
TRIED = 32


@dataclass(frozen=True)
class Parity:
    """How an exported network compares with torch, on so many random views."""

    views: int
    largest: float
    """Difference of scores, or of descriptors."""
    same_first: float
    """Share of views with the same best place, or nearest descriptor."""


class Scores(nn.Module):
    """Heights (1, rings, sectors) in metres → scores (1, places), features (1, 64) and headings in
    degrees (1, places)."""

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


def export(source: Path, out: Path) -> str:
    """Write FILE.onnx with its parity beside it, or FILE.site that answers through it; returns what
    was written, in a line.

    Raises ConfigError for a method without a network, or an ending that says neither.
    """
    about, model, arrays, network, _ = site_file.read(source)
    if out.suffix not in (".onnx", ".site"):
        raise ConfigError(f"-o {out}: expected FILE.onnx or FILE.site")
    if network is not None:
        raise ConfigError(f"{source}: is exported already; export the site that it came from")
    method = build(about["method"], site.ROOTS)
    data, parity = exported(method, model)
    found = (
        f"on {parity.views} views {parity.largest:.1e} off torch at most, {parity.same_first:.0%} "
        "with the same best place"
    )
    if parity.largest > ALIKE:
        raise ConfigError(f"{source}: {found}; over {ALIKE:g}, nothing was written")
    if out.suffix == ".site":
        if not isinstance(method, Classifier):
            raise ConfigError(
                f"-o {out}: only sci and sci_ring can answer through ONNX; FILE.onnx holds this "
                "network alone"
            )
        own = {key: array for key, array in model.items() if not key.startswith(loop.NET)}
        answering = {key: value for key, value in about.items() if key != "growth"}
        site_file.write(out, site_file.Parts(answering, own, arrays, data))
    else:
        with replaced(out) as scratch:
            scratch.write_bytes(data)
        beside = {
            "views": parity.views,
            "largest_difference": parity.largest,
            "same_first": parity.same_first,
        }
        with replaced(out.with_suffix(".parity.json")) as scratch:
            scratch.write_text(
                json.dumps({"site": about["name"], **beside}, indent=1, allow_nan=False) + "\n",
                encoding="utf-8",
            )
    return f"{out}: {out.stat().st_size / 1e6:.1f} MB; {found}"


def exported(method: Any, model: Mapping[str, NDArray[Any]]) -> tuple[bytes, Parity]:
    """A method's network as an ONNX file's bytes, and its parity; raises ConfigError for a method
    without one."""
    rng = np.random.default_rng(0)
    if isinstance(method, Classifier):
        method = replace(method, precision="f32", threads=1)
        rings, sectors = (int(side) for side in model["image_shape"])
        net = method.network(len(model["place_xy_m"]), rings, sectors)
        loop.fill(net, model)
        module: nn.Module = Scores(method, net)
        views = rng.uniform(0, method.h_max_m, (TRIED, rings, sectors)) * (
            rng.uniform(size=(TRIED, rings, sectors)) < 0.5
        )
        given = INPUT
        names = list(CLASSIFIED)
    elif isinstance(method, PointNetVlad):
        module = Describer()
        loop.fill(module, model)
        views = rng.uniform(-1, 1, (TRIED, int(model["points"]), 3))
        given = "points"
        names = ["descriptor"]
    else:
        raise ConfigError(
            f"{type(method).__name__}: has no network to export; sci, sci_ring and pointnetvlad "
            "have one"
        )
    inputs = torch.from_numpy(views.astype(np.float32))
    data = _onnx(module.eval(), inputs[:1], given, names)
    run = session(data)
    with torch.no_grad(), loop.reproducible(1):
        ours = [_first(module(one[None])) for one in inputs]
    theirs = [_first(run.run(None, {given: one[None].numpy()})) for one in inputs]
    largest = max(float(np.abs(a - b).max()) for a, b in zip(ours, theirs, strict=True))
    same = np.mean([a.argmax() == b.argmax() for a, b in zip(ours, theirs, strict=True)])
    return data, Parity(TRIED, largest, float(same))


def _first(answers: Any) -> NDArray[np.float64]:
    """The output that is compared: scores, or the descriptor."""
    return np.asarray(answers if isinstance(answers, Tensor) else answers[0], np.float64)


def _onnx(module: nn.Module, example: Tensor, given: str, outputs: list[str]) -> bytes:
    """The file's bytes; torch's exporter talks of what does not matter here."""
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
                input_names=[given],
                output_names=outputs,
                verbose=False,
            )
        except ImportError as error:
            raise ConfigError(
                f"{error.name}: not installed; `pip install 'yearloc[onnx]'`"
            ) from None
    assert program is not None
    return bytes(program.model_proto.SerializeToString())
