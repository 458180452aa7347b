"""Tests of reading the checkpoint of PointNetVLAD's authors, which is written here byte by byte as
TensorFlow writes one."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.core.errors import ConfigError
from pipeline.methods.pointnetvlad.checkpoint import is_checkpoint, read_checkpoint
from pipeline.methods.pointnetvlad.netvlad import Describer
from pipeline.methods.pointnetvlad.weights import load, renamed

FEATURES, CLUSTERS, SIZE = 16, 4, 8
SCOPE = "query_triplets"


def varint(number: int) -> bytes:
    out = b""
    while number >= 0x80:
        out += bytes([number & 0x7F | 0x80])
        number >>= 7
    return out + bytes([number])


def field(number: int, value: int | bytes) -> bytes:
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    return varint(number << 3 | 2) + varint(len(value)) + value


def block(entries: Mapping[str, bytes]) -> bytes:
    """A block without compression, its keys sharing beginnings, with its trailer."""
    out = b""
    before = b""
    for name, value in entries.items():
        key = name.encode()
        shared = next(
            (i for i, (a, b) in enumerate(zip(before, key, strict=False)) if a != b),
            min(len(before), len(key)),
        )
        out += varint(shared) + varint(len(key) - shared) + varint(len(value))
        out += key[shared:] + value
        before = key
    return out + (0).to_bytes(4, "little") + (1).to_bytes(4, "little") + b"\0" + b"crc!"


def write(prefix: Path, tensors: Mapping[str, np.ndarray]) -> None:
    """An index of two blocks, and one shard."""
    entries = {"": field(1, 1)}  # the header: one shard
    data = b""
    for name in sorted(tensors):
        numbers = tensors[name]
        shape = b"".join(field(2, field(1, side)) for side in numbers.shape)
        kind = {"float32": 1, "int64": 9, "bool": 10}[numbers.dtype.name]
        place = field(1, kind) + field(2, shape) + field(4, len(data)) + field(5, numbers.nbytes)
        entries[name] = place + b"\x35crc!"  # its checksum, four bytes of field 6
        data += numbers.tobytes()
    names = list(entries)
    halves = [names[: len(names) // 2], names[len(names) // 2 :]]
    table = b""
    index = {}
    for half in halves:
        whole = block({name: entries[name] for name in half})
        index[half[-1]] = varint(len(table)) + varint(len(whole) - 5)
        table += whole
    handles = b""
    for whole in (block({}), block(index)):
        handles += varint(len(table)) + varint(len(whole) - 5)
        table += whole
    footer = handles.ljust(40, b"\0") + (0xDB4775248B80FB57).to_bytes(8, "little")
    prefix.with_name(f"{prefix.name}.index").write_bytes(table + footer)
    prefix.with_name(f"{prefix.name}.data-00000-of-00001").write_bytes(data)


def authors() -> dict[str, np.ndarray]:
    """Tensors as their network of smaller size has them, and some of its optimizer."""
    rng = np.random.default_rng(0)
    shapes: dict[str, tuple[int, ...]] = {}
    for scope, width, last in (
        ("transform_net1", 3, "transform_XYZ"),
        ("transform_net2", 64, "transform_feat"),
    ):
        first = (1, 3, 1, 64) if width == 3 else (1, 1, 64, 64)
        layers = {"tconv1": first, "tconv2": (1, 1, 64, 128), "tconv3": (1, 1, 128, 1024)}
        layers |= {"tfc1": (1024, 512), "tfc2": (512, 256)}
        for name, shape in layers.items():
            place = f"{scope}/{name}"
            shapes |= {f"{place}/weights": shape, f"{place}/biases": shape[-1:]}
            shapes |= {f"{place}/bn/{part}": shape[-1:] for part in ("beta", "gamma")}
            for moment in ("Squeeze", "Squeeze_1"):
                average = f"{place}/bn/{SCOPE}/{place}/bn/moments/{moment}"
                shapes[f"{average}/ExponentialMovingAverage"] = shape[-1:]
        shapes |= {f"{scope}/{last}/weights": (256, width**2)}
        shapes |= {f"{scope}/{last}/biases": (width**2,)}
    trunk = {"conv1": (1, 3, 1, 64), "conv2": (1, 1, 64, 64), "conv3": (1, 1, 64, 64)}
    trunk |= {"conv4": (1, 1, 64, 128), "conv5": (1, 1, 128, FEATURES)}
    for name, shape in trunk.items():
        shapes |= {f"{name}/weights": shape, f"{name}/biases": shape[-1:]}
        shapes |= {f"{name}/weights/Adam": shape}
    shapes |= {"cluster_weights": (FEATURES, CLUSTERS), "gating_weights": (SIZE, SIZE)}
    shapes |= {"cluster_weights2": (1, FEATURES, CLUSTERS)}
    shapes |= {"hidden1_weights": (FEATURES * CLUSTERS, SIZE)}
    for name, width in (("cluster_bn", CLUSTERS), ("bn", SIZE), ("gating_bn", SIZE)):
        for part in ("beta", "gamma", "moving_mean", "moving_variance"):
            shapes[f"{name}/{part}"] = (width,)
    positive = ("gamma", "moving_variance", "Squeeze_1/ExponentialMovingAverage")
    return {
        f"{SCOPE}/{name}": np.float32(name.endswith(positive))
        + rng.normal(0, 0.05, shape).astype(np.float32)
        for name, shape in shapes.items()
    } | {"global_step": np.array(7, np.int64), "flag": np.array([True])}


def test_what_is_written_is_read_without_tensorflow(tmp_path: Path) -> None:
    prefix = tmp_path / "model.ckpt"
    tensors = authors()
    write(prefix, tensors)
    result = read_checkpoint(prefix)
    assert result.keys() == tensors.keys() - {"flag"}  # a type that no weight has
    for name, numbers in result.items():
        np.testing.assert_array_equal(numbers, tensors[name])
    assert is_checkpoint(prefix)
    assert not is_checkpoint(tmp_path / "other")


def test_the_authors_weights_fill_the_network(tmp_path: Path) -> None:
    tensors = authors()
    write(tmp_path / "model.ckpt", tensors)
    net = Describer(FEATURES, CLUSTERS, SIZE)
    load(net, tmp_path / "model.ckpt")
    of_theirs = {name.removeprefix(f"{SCOPE}/"): numbers for name, numbers in tensors.items()}
    first = net.pointnet.early[0].weight.detach().numpy()
    np.testing.assert_array_equal(first, of_theirs["conv1/weights"][0, :, 0].T)
    base = net.pointnet.turn.base.bias.detach().numpy()
    expected = of_theirs["transform_net1/transform_XYZ/biases"] + np.eye(3).ravel()
    np.testing.assert_allclose(base, expected, rtol=1e-6)
    norm = net.pointnet.mix.cloud[0][1]
    place = f"transform_net2/tfc1/bn/{SCOPE}/transform_net2/tfc1/bn/moments"
    for statistic, moment in (("running_mean", "Squeeze"), ("running_var", "Squeeze_1")):
        theirs = of_theirs[f"{place}/{moment}/ExponentialMovingAverage"]
        np.testing.assert_array_equal(getattr(norm, statistic).numpy(), theirs)
    np.testing.assert_array_equal(
        net.netvlad.project_norm.weight.detach().numpy(), of_theirs["bn/gamma"]
    )
    with torch.inference_mode():
        lengths = net.eval()(torch.zeros(2, 5, 3)).norm(dim=1)
    np.testing.assert_allclose(lengths.numpy(), 1.0, rtol=1e-5)


def test_a_checkpoint_that_is_damaged_or_of_another_network_is_one_line(tmp_path: Path) -> None:
    prefix = tmp_path / "model.ckpt"
    tensors = authors()
    write(prefix, tensors)
    data = tmp_path / "model.ckpt.data-00000-of-00001"
    data.write_bytes(data.read_bytes()[:-4])
    with pytest.raises(ConfigError, match="ends before tensor query_triplets/"):
        read_checkpoint(prefix)
    data.unlink()
    with pytest.raises(ConfigError, match="no such file; it belongs to"):
        read_checkpoint(prefix)
    index = tmp_path / "model.ckpt.index"
    index.write_bytes(index.read_bytes()[:-9])
    with pytest.raises(ConfigError, match="no index of a TensorFlow checkpoint"):
        read_checkpoint(prefix)
    del tensors[f"{SCOPE}/hidden1_weights"]
    with pytest.raises(ConfigError, match="no tensor …/hidden1_weights"):
        renamed(tensors)
    tensors[f"{SCOPE}/hidden1_weights"] = np.ones((3, SIZE), np.float32)
    write(prefix, tensors)
    with pytest.raises(ConfigError, match=r"netvlad.project.weight is \(8, 3\), expected"):
        load(Describer(FEATURES, CLUSTERS, SIZE), prefix)
