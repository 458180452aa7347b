"""Tests fetching from a local server that drops connections, changes its files and errs, and the
unpacking of archives that are damaged or made to do harm."""

import gzip
import hashlib
import io
import shutil
import subprocess
import sys
import tarfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import requests
import yaml

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.progress import Progress
from pipeline.fetching.archives import Publisher
from pipeline.fetching.download import CHUNK, Downloader
from pipeline.fetching.unpacking import unpack
from pipeline.readers.nclt import Nclt
from tests.readers.damage import one_line

ROOT = Path(__file__).parents[2]
DATE = "2012-01-08"
START = 1_326_030_975_000_000
BIG = np.random.default_rng(0).bytes(40 * CHUNK + 123)
"""A file of 40 chunks and a bit."""
REST = len(BIG) - 10 * CHUNK
"""Its bytes after the first ten chunks."""


@dataclass
class Served:
    """What the server holds, how it misbehaves, and what it was asked."""

    files: dict[str, bytes] = field(default_factory=dict)
    answers: list[Callable[["Handler", bytes], bool]] = field(default_factory=list)
    """Functions that answer one GET each; if one returns False, the handler answers as usual."""
    seen: list[tuple[str, str, str | None]] = field(default_factory=list)
    """Method, path and Range of each request."""
    tag: str | None = None
    """The ETag of all files; "" for none, None for one by the content of the file."""
    address: str = ""

    def gets(self) -> list[tuple[str, str | None]]:
        """Path and Range of each GET."""
        return [(path, given) for method, path, given in self.seen if method == "GET"]


class Handler(BaseHTTPRequestHandler):
    """Answers requests from the files of `served`, with ranges, unless its `answers` do."""

    served: Served
    protocol_version = "HTTP/1.1"

    def log_message(self, *_: Any) -> None:
        pass

    def do_HEAD(self) -> None:
        self.served.seen.append(("HEAD", self.path.lstrip("/"), None))
        self.reply(0)

    def do_GET(self) -> None:
        data = self.served.files.get(self.path.lstrip("/"))
        answers = self.served.answers if data is not None else []
        self.served.seen.append(("GET", self.path.lstrip("/"), self.headers.get("Range")))
        if answers and answers.pop(0)(self, data or b""):
            self.close_connection = True
        else:
            self.reply(None)

    def reply(self, limit: int | None) -> None:
        """Send the file, or the range that is asked for; at most `limit` bytes of it."""
        data = self.served.files.get(self.path.lstrip("/"))
        if data is None:
            return self.head(404, 0)
        tag = self.served.tag
        if tag is None:
            tag = f'"{hashlib.sha256(data).hexdigest()}"'
        start = 0
        if self.headers.get("If-Range") == tag:
            start = int((self.headers.get("Range") or "bytes=0-")[6:-1])
        if start:
            content_range = f"bytes {start}-{len(data) - 1}/{len(data)}"
            self.head(206, len(data) - start, ETag=tag, Content_Range=content_range)
        else:
            self.head(200, len(data), ETag=tag)
        self.wfile.write(data[start:][:limit])

    def head(self, status: int, length: int | None, **headers: str) -> None:
        """Send the head of an answer; `_` in the name of a header stands for `-`."""
        self.send_response(status)
        for name, value in headers.items():
            if value:
                self.send_header(name.replace("_", "-"), value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.end_headers()


Answer = Callable[[Handler, bytes], bool]


class Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: Any) -> None:
        """A client that hangs up is no error here."""


def drops(after: int) -> Answer:
    """An answer that sends `after` bytes of what is asked for, and hangs up."""

    def answer_once(handler: Handler, data: bytes) -> bool:
        handler.reply(after)
        return True

    return answer_once


def says(status: int, length: int | None = 0, body: bytes = b"", **headers: str) -> Answer:
    """An answer with this status and body; `length` is what its header claims."""

    def answer_once(handler: Handler, data: bytes) -> bool:
        handler.head(status, length, **headers)
        handler.wfile.write(body)
        return True

    return answer_once


def hangs(handler: Handler, data: bytes) -> bool:
    """An answer that comes too late."""
    threading.Event().wait(1.0)
    return True


def usual(handler: Handler, data: bytes) -> bool:
    """An answer that the handler gives as usual."""
    return False


@pytest.fixture
def served() -> Iterator[Served]:
    """A running server without files."""
    held = Served()
    server = Server(("127.0.0.1", 0), type("Bound", (Handler,), {"served": held}))
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    held.address = f"http://127.0.0.1:{server.server_address[1]}/"
    yield held
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture
def big(served: Served) -> Served:
    """A server with the file BIG."""
    served.files["big"] = BIG
    return served


def download(served: Served, path: Path, tries: int = 5, name: str = "big") -> bytes:
    """The bytes of a file that is downloaded to `path`."""
    Downloader(tries, timeout_s=0.3, wait_s=0.001).fetch(served.address + name, path, Progress())
    return path.read_bytes()


def arrived(served: Served) -> list[int]:
    """The first byte that each GET asked for."""
    return [int((given or "bytes=0-")[6:-1]) for _, given in served.gets()]


# One file


TEN = 10 * CHUNK
RANGE = f"bytes {10 * CHUNK}-{len(BIG) - 1}/{len(BIG)}"


@pytest.mark.parametrize(
    ("answers", "starts"),
    [
        ([], [0]),
        # Whole chunks of 65,536 bytes are kept: of 10 and a half chunks ten, then of five more all.
        ([drops(TEN + CHUNK // 2), drops(5 * CHUNK)], [0, TEN, 15 * CHUNK]),
        # A server that ignores ranges sends all again.
        ([drops(TEN), says(200, len(BIG), BIG)], [0, TEN]),
        # Another part than was asked for is thrown away.
        ([drops(TEN), says(206, 10, bytes(10), Content_Range="bytes 0-9/10")], [0, TEN, 0]),
        (
            [
                drops(TEN),
                says(206, 10, bytes(10), Content_Range=f"bytes {TEN}-{TEN + 9}/{len(BIG)}"),
            ],
            [0, TEN, 0],
        ),
        ([drops(TEN), says(206, 10, bytes(10))], [0, TEN, 0]),
        ([drops(TEN), says(416, 0, Content_Range="bytes */5")], [0, TEN, 0]),
        # The right part, of a file that has changed, from a server that ignores If-Range.
        (
            [drops(TEN), says(206, REST, BIG[-REST:], Content_Range=RANGE, ETag='"another"')],
            [0, TEN, 0],
        ),
        ([hangs], [0, 0]),
        *(([says(status), says(status)], [0, 0, 0]) for status in (408, 429, 500, 502, 503, 504)),
    ],
)
def test_a_file_arrives_whole_in_spite_of_failures(
    big: Served, tmp_path: Path, answers: list[Answer], starts: list[int]
) -> None:
    big.answers = list(answers)
    assert download(big, tmp_path / "big") == BIG
    assert [path.name for path in tmp_path.iterdir()] == ["big"]
    assert arrived(big) == starts


@pytest.mark.parametrize(
    ("answers", "asked", "match"),
    [
        ([hangs] * 9, 3, "gave up after 3 tries, the last one: ReadTimeout"),
        ([says(503)] * 9, 3, "gave up after 3 tries, the last one: TryAgainError: 503"),
        (
            [says(200, len(BIG) + 5, BIG, ETag='"x"'), *[says(200, len(BIG) + 5, BIG)] * 9],
            3,
            "gave up after 3 tries",
        ),
        *(
            ([says(status)], 1, f"/big: the server says {status} .*is there such a")
            for status in (400, 401, 403, 404, 410)
        ),
        ([says(200, None, BIG)], 1, "does not say how long the file is"),
        ([says(200, -1)], 1, "does not say how long the file is"),
        ([says(200, len(BIG), BIG, Content_Encoding="br")], 1, "does not say how long the file is"),
        *(
            ([says(301, Location=to)], 1, "is the base address right")
            for to in (
                "file:///etc/passwd",
                "ftp://127.0.0.1/big",
                "gopher:x",
                "http://[",
                "javascript:1",
            )
        ),
        ([says(301, Location="/big")] * 50, 6, "more than 5 times"),
    ],
)
def test_a_file_that_cannot_be_fetched_raises_an_error_of_one_line(
    big: Served, tmp_path: Path, answers: list[Answer], asked: int, match: str
) -> None:
    big.answers = list(answers)
    with one_line(LogError, match):
        download(big, tmp_path / "big", tries=3)
    assert len(big.seen) == asked
    assert not (tmp_path / "big").exists()


def test_a_later_call_resumes_the_download_of_an_earlier_one(big: Served, tmp_path: Path) -> None:
    big.answers = [drops(7 * CHUNK)]
    with pytest.raises(
        LogError,
        match=r"gave up after 1 tries, the last one: .*; what has arrived is kept, call again",
    ):
        download(big, tmp_path / "big", tries=1)
    assert not (tmp_path / "big").exists()
    assert download(big, tmp_path / "big", tries=1) == BIG
    assert arrived(big) == [0, 7 * CHUNK]


def test_the_download_of_a_killed_process_is_resumed(big: Served, tmp_path: Path) -> None:
    def stalls(handler: Handler, data: bytes) -> bool:
        drops(9 * CHUNK)(handler, data)
        handler.wfile.flush()
        threading.Event().wait(20)
        return True

    big.answers = [stalls]
    code = (
        "from pathlib import Path; from pipeline.fetching.download import Downloader\nfrom "
        "pipeline.core.progress import Progress\nDownloader(1, 60.0, "
        f"1.0).fetch({big.address + 'big'!r}, Path({str(tmp_path / 'big')!r}), Progress())"
    )
    process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT)
    part = tmp_path / "big.part"
    for _ in range(1000):
        if part.is_file() and part.stat().st_size >= 8 * CHUNK:
            break
        threading.Event().wait(0.02)
    process.kill()
    process.wait()
    kept = part.stat().st_size
    assert kept >= 8 * CHUNK
    assert download(big, tmp_path / "big") == BIG
    assert arrived(big) == [0, kept]


def test_a_file_that_arrived_whole_before_a_kill_is_not_asked_for_again(
    big: Served, tmp_path: Path
) -> None:
    big.answers = [drops(len(BIG) - 1)]
    with pytest.raises(LogError):
        download(big, tmp_path / "big", tries=1)
    (tmp_path / "big.part").write_bytes(BIG)
    assert download(big, tmp_path / "big") == BIG
    assert len(big.gets()) == 1


def test_a_file_that_changed_between_tries_is_not_pieced_together(
    big: Served, tmp_path: Path
) -> None:
    def changes(handler: Handler, data: bytes) -> bool:
        done = drops(10 * CHUNK)(handler, data)
        big.files["big"] = BIG[::-1]
        return done

    big.answers = [changes]
    assert download(big, tmp_path / "big") == BIG[::-1]


@pytest.mark.parametrize("tag", ["", 'W/"weak"', "torn"])
def test_without_a_strong_tag_nothing_is_resumed(big: Served, tmp_path: Path, tag: str) -> None:
    big.tag = tag
    big.answers = [says(200, len(BIG), BIG[: 10 * CHUNK], ETag=tag)]
    assert download(big, tmp_path / "big") == BIG
    assert arrived(big) == [0, 0]


def test_a_redirection_is_followed_and_the_rest_asked_for_there(
    big: Served, tmp_path: Path
) -> None:
    big.files["moved"] = BIG
    big.answers = [
        says(302, Location="/moved"),
        drops(5 * CHUNK),
        says(307, Location=f"{big.address}moved"),
    ]
    assert download(big, tmp_path / "big") == BIG
    assert big.gets() == [
        ("big", None),
        ("moved", None),
        ("big", f"bytes={5 * CHUNK}-"),
        ("moved", f"bytes={5 * CHUNK}-"),
    ]


def test_a_redirection_from_https_to_http_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = requests.Response()
    answer.status_code = 302
    answer.raw = io.BytesIO()
    answer.headers["Location"] = "http://127.0.0.1/big"
    monkeypatch.setattr(requests, "request", lambda *_, **__: answer)
    with one_line(LogError, r"sends us on to http://127\.0\.0\.1/big, which is not followed"):
        Downloader(1, 1.0, 0.001).fetch("https://127.0.0.1/big", tmp_path / "big", Progress())


def test_progress_is_shown_chunk_by_chunk(big: Served, tmp_path: Path) -> None:
    seen = []

    class Seen(Progress):
        def track(self, items: Any, total: int, what: str) -> Iterator[Any]:
            chunks = list(items)
            seen.append((what, total, len(chunks)))
            yield from chunks

    big.answers = [drops(20 * CHUNK)]
    with pytest.raises(LogError):
        download(big, tmp_path / "big", tries=1)
    Downloader(1, 1.0, 0.001).fetch(big.address + "big", tmp_path / "big", Seen())
    assert seen == [("big from 50 %", 21, 21)]  # 20 of 40 chunks and 123 bytes are here


# Archives


def tarred(path: Path, *members: tuple[str, bytes | str], **odd: Any) -> Path:
    """Write a .tar.gz of members: files (name, bytes), or others (name, "TYPE target")."""
    with tarfile.open(path, "w:gz") as tar:
        for name, data in members:
            info = tarfile.TarInfo(name)
            if isinstance(data, str):
                info.type = getattr(tarfile, data.split()[0])
                info.linkname = data.partition(" ")[2]
                tar.addfile(info)
            else:
                info.size = len(data)
                tar.addfile(info, io.BytesIO(data))
    return path


def test_the_folders_around_the_target_in_an_archive_are_dropped(tmp_path: Path) -> None:
    for number, head in enumerate(("", "./", f"{DATE}/", f"velodyne_data/{DATE}/")):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = tarred(
            tmp_path / "a.tar.gz", (f"{head}scans/1.bin", b"one"), (f"{head}hits.bin", b"hits")
        )
        assert unpack(path, folder, "scans") == 2
        assert sorted(str(file.relative_to(folder)) for file in folder.rglob("*")) == [
            "hits.bin",
            "scans",
            "scans/1.bin",
        ]
    assert not (tmp_path / "a.tar.gz.unpacking").exists()


@pytest.mark.parametrize(
    ("members", "says"),
    [
        ([("/etc/evil", b"x")], "would write to '/etc/evil', outside its folder"),
        ([("../evil", b"x")], "would write to '../evil'"),
        ([("a/../../evil", b"x")], "outside its folder"),
        ([("a\\..\\..\\evil", b"x")], "outside its folder"),
        ([("C:/evil", b"x")], "outside its folder"),
        ([("link", "SYMTYPE /etc"), ("link/evil", b"x")], "'link' is a link or a device"),
        ([("link", "SYMTYPE ok")], "is a link or a device"),
        ([("link", "LNKTYPE ../../evil")], "is a link or a device"),
        ([("pipe", "FIFOTYPE")], "is a link or a device"),
        ([("null", "CHRTYPE")], "is a link or a device"),
        ([("disk", "BLKTYPE")], "is a link or a device"),
        ([("else", b"x")], "holds no ok; it is not the archive"),
    ],
)
def test_an_archive_that_reaches_outside_is_refused_whole(
    tmp_path: Path, members: list[tuple[str, Any]], says: str
) -> None:
    store = tmp_path / "store"
    folder = tmp_path / "folder"
    store.mkdir(), folder.mkdir()
    path = tarred(store / "a.tar.gz", *([] if "holds" in says else [("ok", b"fine")]), *members)
    with pytest.raises(LogError, match=says):
        unpack(path, folder, "ok")
    assert [file.relative_to(tmp_path).as_posix() for file in sorted(tmp_path.rglob("*"))] == [
        "folder",
        "store",
        "store/a.tar.gz",
    ]


def test_an_archive_larger_than_the_disk_is_refused_before_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tarred(tmp_path / "a.tar.gz", ("ok", b"fine"), ("zeros", bytes(10**6)))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 0, 10**6))  # type: ignore[attr-defined]
    with pytest.raises(LogError, match=r"unpacks to more than the 0.0 GB free"):
        unpack(path, tmp_path / "folder", "ok")


def header(name: str, claims: int, kind: bytes) -> bytes:
    """The header of a tar's member that claims to have so many bytes."""
    info = tarfile.TarInfo(name)
    info.size = claims
    info.type = kind
    return info.tobuf(tarfile.GNU_FORMAT)


WHOLE = gzip.compress(header("ok", 600, tarfile.REGTYPE) + bytes(1024) + bytes(1024), mtime=0)
DAMAGED = {
    "empty": b"",
    "text": b"no gzip",
    "cut": WHOLE[:20],
    "cut at the end": WHOLE[:-1],
    "checksum": WHOLE[:-8] + bytes(8),
    "no tar": gzip.compress(b"no tar" * 200),
    "nothing": gzip.compress(b""),
    # Headers that claim 8 GB, to fill the memory, and members of negative length.
    **{
        f"header {kind!r}": gzip.compress(header("bomb", 8 * 10**9, kind) + bytes(2048))
        for kind in (tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.GNUTYPE_LONGNAME)
    },
    **{
        f"length {n}": gzip.compress(header("odd", n, tarfile.REGTYPE) + bytes(2048))
        for n in (-1, -512, -10_000)
    },
}


@pytest.mark.parametrize("fault", DAMAGED)
def test_a_damaged_archive_is_removed_and_nothing_kept_of_it(tmp_path: Path, fault: str) -> None:
    path = tmp_path / "a.tar.gz"
    path.write_bytes(DAMAGED[fault])
    with pytest.raises(
        LogError,
        match=r"a.tar.gz: (damaged .* and removed; fetch it again|holds no ok|'odd' is a link)",
    ):
        unpack(path, tmp_path, "ok")
    assert not path.exists() or fault not in [name for name in DAMAGED if name.startswith("header")]
    assert not (tmp_path / "ok").exists()
    assert not (tmp_path / "a.tar.gz.unpacking").exists()


def test_a_folder_in_the_way_is_named_and_not_touched(tmp_path: Path) -> None:
    (tmp_path / "ok").mkdir()
    (tmp_path / "ok" / "mine").touch()
    with pytest.raises(LogError, match=r"ok: is in the way of what a\.tar\.gz holds"):
        unpack(tarred(tmp_path / "a.tar.gz", ("x/ok/1", b"1")), tmp_path, "ok")
    assert (tmp_path / "ok" / "mine").exists()


# A data set


def conf() -> dict[str, Any]:
    """The project's own settings for NCLT."""
    said: dict[str, Any] = yaml.safe_load((ROOT / "conf/fetch/nclt.yaml").read_text())
    return said


def publisher(served: Served, **change: Any) -> Publisher:
    """The publisher of NCLT on the local server, with some settings changed."""
    return Publisher.of(
        {**conf(), "base": served.address, "tries": 4, "timeout_s": 1.0, "wait_s": 0.001, **change}
    )


def fetch(served: Served, root: Path, *sequences: str, **change: Any) -> list[str]:
    """Fetch sequences from the local server; returns the lines on the progress."""
    return list(publisher(served, **change).fetch(root, sequences, Progress()))


@pytest.fixture
def nclt(served: Served, tmp_path: Path) -> Served:
    """A server with one date as NCLT's publisher has it.

    The vehicle drives ten metres north in a second, its wheels say 12 m/s, and there is one scan.
    """
    rows = [
        (
            f"{START + 100_000 * i}, {i}, 0, 0, 0, 0, 0\n",
            f"{START + 100_000 * i}, {1.2 * i}, 0, 0, 0, 0, 0\n",
        )
        for i in range(11)
    ]
    ground_truth, wheels = ("".join(column).encode() for column in zip(*rows, strict=True))
    scan = np.array([20_200, 20_400, 19_600, 0], "<u2").tobytes()
    sensors = tarred(
        tmp_path / "sen", (f"{DATE}/gps.csv", b"1"), (f"{DATE}/odometry_mu_100hz.csv", wheels)
    )
    scans = tarred(
        tmp_path / "vel",
        (f"{DATE}/velodyne_hits.bin", BIG),
        (f"{DATE}/velodyne_sync/{START + 150_000}.bin", scan),
    )
    served.files = {
        f"ground_truth/groundtruth_{DATE}.csv": ground_truth,
        f"sensor_data/{DATE}_sen.tar.gz": sensors.read_bytes(),
        f"velodyne_data/{DATE}_vel.tar.gz": scans.read_bytes(),
    }
    return served


def test_a_date_is_fetched_unpacked_and_read_and_fetched_once(nclt: Served, tmp_path: Path) -> None:
    nclt.answers = [usual, says(503), usual, drops(10 * CHUNK), drops(10 * CHUNK)]
    root = tmp_path / "root"
    lines = fetch(nclt, root, DATE)
    assert [line.split(":")[0] for line in lines] == [
        f"groundtruth_{DATE}.csv",
        f"{DATE}_sen.tar.gz",
        f"{DATE}_vel.tar.gz",
    ]
    assert lines[2].startswith(
        f"{DATE}_vel.tar.gz: {len(nclt.files[f'velodyne_data/{DATE}_vel.tar.gz']) / 1e6:.1f} MB, "
        "files: 2"
    )
    log = Nclt().open(root, DATE)
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [1.5, 0, 0])
    np.testing.assert_allclose(log.odom_T_scan[0, :3, 3], [1.8, 0, 0])
    np.testing.assert_allclose(log.points(0), [[1, -2, 2]])
    assert (root / DATE / "velodyne_hits.bin").read_bytes() == BIG
    assert Nclt().sequences(root) == {DATE: []}
    left = sorted(path.name for path in (root / "archives").iterdir() if path.name != ".lock")
    assert left == [
        f"{DATE}_sen.tar.gz.sha256",
        f"{DATE}_vel.tar.gz.sha256",
        f"groundtruth_{DATE}.csv.sha256",
    ]
    nclt.seen.clear()  # a second call fetches nothing, of a date that is named twice neither
    lines = fetch(nclt, root, DATE, DATE)
    assert [line.split(": ")[1] for line in lines] == ["here already"] * 3
    assert nclt.seen == []


def test_a_later_fetch_is_checked_against_the_recorded_sum(nclt: Served, tmp_path: Path) -> None:
    root = tmp_path / "root"
    fetch(nclt, root, DATE)
    path = f"ground_truth/groundtruth_{DATE}.csv"
    digest = hashlib.sha256(nclt.files[path]).hexdigest()
    recorded = root / "archives" / f"groundtruth_{DATE}.csv.sha256"
    assert recorded.read_text() == f"{digest}  groundtruth_{DATE}.csv\n"
    (root / DATE / f"groundtruth_{DATE}.csv").unlink()
    nclt.files[path] = nclt.files[path].replace(b"0", b"1")
    with pytest.raises(
        LogError, match=rf"{recorded} says {digest}; damaged, or changed by its publisher"
    ):
        fetch(nclt, root, DATE)
    assert not (root / DATE / f"groundtruth_{DATE}.csv").exists()


def test_a_file_is_checked_against_the_sum_of_the_publisher(nclt: Served, tmp_path: Path) -> None:
    path = f"ground_truth/groundtruth_{DATE}.csv"
    digest = hashlib.sha256(nclt.files[path]).hexdigest()
    assert len(fetch(nclt, tmp_path / "good", DATE, sha256={path: digest})) == 3
    with pytest.raises(LogError, match=f"its sha256 is {digest}, fetch.sha256 says {'0' * 64}"):
        fetch(nclt, tmp_path / "bad", DATE, sha256={path: "0" * 64})


def test_the_room_on_the_disk_is_checked_before_a_byte_is_fetched(
    nclt: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Unpacked: the csv once, 5 × the sensors', 2.5 × the scans' archive, and beside them the scans'
    # archive itself.
    sizes = [len(data) for data in nclt.files.values()]
    need = sizes[0] + 5 * sizes[1] + 3.5 * sizes[2]
    monkeypatch.setattr(
        shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 0, int(need) - 1)
    )  # type: ignore[attr-defined]
    with pytest.raises(
        LogError,
        match=r"the 3 files and what they unpack to need about 0.0 GB, 0.0 GB are free; make room",
    ):
        fetch(nclt, tmp_path / "root", DATE)
    assert nclt.gets() == []
    monkeypatch.setattr(
        shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 0, int(need) + 1)
    )  # type: ignore[attr-defined]
    assert len(fetch(nclt, tmp_path / "root", DATE)) == 3


def test_a_damaged_archive_is_fetched_again_by_the_next_call(nclt: Served, tmp_path: Path) -> None:
    path = f"sensor_data/{DATE}_sen.tar.gz"
    whole = nclt.files[path]
    nclt.files[path] = whole[:-20]  # the publisher's length is as wrong as its content
    with pytest.raises(LogError, match=f"{DATE}_sen.tar.gz: damaged .*fetch it again"):
        fetch(nclt, tmp_path / "root", DATE)
    assert not (tmp_path / "root" / DATE / "odometry_mu_100hz.csv").exists()
    nclt.files[path] = whole
    assert len(fetch(nclt, tmp_path / "root", DATE)) == 3


def test_an_interrupted_unpacking_starts_over_from_the_archive_on_disk(
    nclt: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "root"

    def killed(*_: Any) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.fetching.archives.unpack", killed)
    with pytest.raises(KeyboardInterrupt):
        fetch(nclt, root, DATE)
    (root / "archives" / f"{DATE}_sen.tar.gz.unpacking" / "half").mkdir(parents=True)
    monkeypatch.undo()
    nclt.seen.clear()
    assert len(fetch(nclt, root, DATE)) == 3
    assert [path for path, _ in nclt.gets()] == [f"velodyne_data/{DATE}_vel.tar.gz"]


def test_two_fetches_do_not_write_one_file(nclt: Served, tmp_path: Path) -> None:
    first = publisher(nclt).fetch(tmp_path / "root", [DATE], Progress())
    next(first)
    with pytest.raises(LogError, match="another fetch is at work there"):
        fetch(nclt, tmp_path / "root", DATE)
    assert len(list(first)) == 2


@pytest.mark.parametrize("sequence", ["2012-1-8", "../2012-01-08", "", "2012-01-08/..", "all"])
def test_a_wrong_name_of_a_sequence_is_refused_before_any_request(
    nclt: Served, tmp_path: Path, sequence: str
) -> None:
    with pytest.raises(ConfigError, match="expected a name like"):
        fetch(nclt, tmp_path / "root", DATE, sequence)
    assert nclt.seen == []
    assert not (tmp_path / "root").exists()


NUMBERED = {"path": "frames/{number}.pcd", "target": "{number}.pcd", "numbers": 3, "nbytes": 1}


def test_numbered_files_are_fetched_and_checked_together(served: Served, tmp_path: Path) -> None:
    served.files = {f"frames/{i}.pcd": bytes([i]) for i in range(3)}
    lines = "".join(f"{hashlib.sha256(bytes([i])).hexdigest()}  {i}.pcd\n" for i in range(3))
    known = NUMBERED | {"listing_sha256": hashlib.sha256(lines.encode()).hexdigest()}
    run = publisher(served, archives=[known], sequence="run", licence="For research.")
    first, licence = run.fetch(tmp_path, ["run"], Progress())
    assert first.startswith("0.pcd … 2.pcd: 0.0 MB, files: 3, sha256")
    assert (licence, (tmp_path / "LICENCE.txt").read_text()) == (
        "For research.",
        f"For research.\nFrom {served.address}\n",
    )
    assert [(tmp_path / f"run/{i}.pcd").read_bytes() for i in range(3)] == [
        bytes([i]) for i in range(3)
    ]
    assert {method for method, _, _ in served.seen} == {"GET"}  # their length is known
    (tmp_path / "run/1.pcd").unlink()
    assert next(run.fetch(tmp_path, ["run"], Progress())).startswith(
        "0.pcd … 2.pcd: 0.0 MB, files: 1"
    )
    assert next(run.fetch(tmp_path, ["run"], Progress())) == "0.pcd … 2.pcd: here already"


def test_numbered_files_of_another_sum_are_removed(served: Served, tmp_path: Path) -> None:
    served.files = {f"frames/{i}.pcd": bytes([i]) for i in range(3)}
    run = publisher(served, archives=[NUMBERED | {"listing_sha256": "0" * 64}], sequence="run")
    with one_line(
        LogError,
        "0.pcd … 2.pcd have the sha256 [0-9a-f]{64}, expected 0{64}; removed, fetch them again",
    ):
        list(run.fetch(tmp_path, ["run"], Progress()))
    assert list((tmp_path / "run").iterdir()) == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"base": "ftp://x/"}, "fetch.base=ftp://x/: expected an address"),
        ({"base": "https://x"}, "expected an address"),
        ({"tries": 0}, "fetch.tries=0"),
        ({"tries": "many"}, "fetch.tries=many"),
        ({"sequence": "("}, "expected a regular expression"),
        ({"sha256": {"a": "123"}}, "fetch.sha256.a: expected 64"),
        ({"mirror": 1}, "unexpected keyword argument 'mirror'"),
        ({"archives": [{"path": "../x", "target": "x"}]}, "expected a path below the base"),
        ({"archives": [{"path": "x", "target": "../x"}]}, "expected a path below the base"),
        ({"archives": [{"path": "x"}]}, "missing 1 required"),
        (
            {"archives": [{"path": "x", "target": "x", "listing_sha256": "12"}]},
            "archives.listing_sha256=12: expected 64",
        ),
    ],
)
def test_the_error_on_a_wrong_setting_names_it(
    served: Served, change: dict[str, Any], says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        publisher(served, **change)
