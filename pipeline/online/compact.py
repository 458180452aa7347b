"""Makes an ONNX model smaller: drops the exporter's notes, stores weights as 8-bit integers."""

from typing import Any

import numpy as np

LEAST_WEIGHTS = 1000
"""Arrays of fewer weights stay as they are."""
MOST_STEPS = 127
"""The largest weight of a row, in 8-bit steps."""


def without_notes(model: Any) -> Any:
    """Drop the notes in an onnx.ModelProto on the code and folders that it was exported from.

    So its bytes do not depend on where the project lies. Changes the model, and returns it.
    """
    model.ClearField("metadata_props")
    graph = model.graph
    graph.ClearField("metadata_props")
    for entries in (graph.node, graph.initializer, graph.value_info, graph.input, graph.output):
        for entry in entries:
            entry.ClearField("metadata_props")
            entry.ClearField("doc_string")
    return model


def with_small_weights(model: Any) -> Any:
    """Store the large float32 weights of an onnx.ModelProto as 8-bit integers.

    Each row along the first axis becomes integers of up to MOST_STEPS and a scale of its own, and a
    node DequantizeLinear multiplies them again. Changes the model, and returns it.
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
