"""OpenVINO's answers of an exported network, on one thread: `python openvino_network.py NETWORK
IMAGES ROWS OUT`."""

import statistics
import sys
import time

import numpy as np
import openvino  # type: ignore[import-not-found]

network, images, rows, out = sys.argv[1:]
heights = np.fromfile(images, "<f4").reshape(int(rows), 1, 40, 120)
core = openvino.Core()
compiled = core.compile_model(
    core.read_model(network), "CPU", {"INFERENCE_NUM_THREADS": 1, "PERFORMANCE_HINT": "LATENCY"}
)
request = compiled.create_infer_request()
took = []
scores = []
for image in [heights[0], *heights]:
    start = time.process_time()
    answer = request.infer([image])
    took.append((time.process_time() - start) * 1000)
    scores.append(answer["scores"].copy())
print(statistics.median(took[1:]))
np.concatenate(scores[1:]).astype("<f4").tofile(out)
