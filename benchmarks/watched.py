"""The picture of `yearloc watch` in docs/: rerun's viewer in a headless Chromium.

`python -m benchmarks.watched DAY.rrd docs/watch.png SECONDS`, after `yearloc watch … --save
DAY.rrd`. The picture is taken after so many seconds, which a machine without a GPU needs to draw.
Chromium must be installed, and websocket-client (the extra `kubernetes` brings it).
"""

import base64
import io
import json
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import requests
from PIL import Image
from websocket import create_connection

WIDTH_PX = 1280
HEIGHT_PX = 900
VIEWER_PORT = 9191
DATA_PORT = 9977
BROWSER_PORT = 9555
COLOURS = 96
BROWSER = (
    "chromium --headless --no-sandbox --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-angle=swiftshader "
    "--enable-unsafe-swiftshader --ignore-gpu-blocklist --remote-allow-origins=* "
    f"--window-size={WIDTH_PX},{HEIGHT_PX} --remote-debugging-port={BROWSER_PORT}"
).split()
PAGE = f"http://127.0.0.1:{VIEWER_PORT}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{DATA_PORT}%2Fproxy"


def main(recording: str, out: Path, wait_s: float) -> None:
    """Serve the recording, open it, wait, and write the PNG."""
    rerun = Path(sys.executable).with_name("rerun")
    serving = f"--serve-web --bind 127.0.0.1 --port {DATA_PORT} --web-viewer-port {VIEWER_PORT}"
    with ExitStack() as stack:
        profile = stack.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
        commands = (
            [str(rerun), recording, *serving.split()],
            [*BROWSER, f"--user-data-dir={profile}", "about:blank"],
        )
        for command in commands:
            process = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
        browser = create_connection(_tab(), timeout=wait_s + 120)
        _call(browser, "Page.navigate", url=PAGE)
        time.sleep(wait_s)
        shot = _call(browser, "Page.captureScreenshot", format="png")["data"]
        image = Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB")
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(out, optimize=True)


def _tab() -> str:
    """The address of the browser's first tab, once it listens."""
    for _ in range(60):
        try:
            tabs = requests.get(f"http://127.0.0.1:{BROWSER_PORT}/json", timeout=5).json()
            return str(next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page"))
        except requests.ConnectionError:
            time.sleep(0.5)
    raise RuntimeError("chromium did not start: is it installed?")


def _call(browser: Any, method: str, **params: Any) -> dict[str, Any]:
    """The result of a method of Chromium's DevTools protocol."""
    browser.send(json.dumps({"id": 1, "method": method, "params": params}))
    while (message := json.loads(browser.recv())).get("id") != 1:
        pass
    result: dict[str, Any] = message["result"]
    return result


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]))
