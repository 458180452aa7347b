"""Downloads one file, and resumes it after a broken connection, also in a later process.

What has arrived lies in FILE.part, and the version of the file that it belongs to (the server's
ETag) in FILE.part.json. The missing bytes are requested with the headers Range and If-Range (RFC
9110, section 14): the server sends a file that has changed meanwhile again from its start.
"""

import json
import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urljoin, urlsplit

import requests
from requests import exceptions
from urllib3.exceptions import NewConnectionError

from pipeline.core.errors import LogError
from pipeline.core.progress import Progress

Result = TypeVar("Result")

CHUNK = 2**16
"""Bytes that are written at a time."""
RETRIED_STATUSES = (408, 425, 429, 500, 502, 503, 504)
"""Status codes after which another try may succeed."""
MAX_REDIRECTS = 5
MAX_FAILED_CONNECTIONS = 3
"""After so many failed connections the address counts as unreachable."""
MAX_DOUBLINGS = 5
"""The wait between tries is doubled so often."""
HEADERS = {"Accept-Encoding": "identity", "User-Agent": "yearloc"}
"""Sent with each request; a compressed answer could not be resumed."""


class TryAgainError(Exception):
    """A failure after which another try may succeed; the text is the reason."""


@dataclass(frozen=True)
class Part:
    """The bytes of a file that have arrived, and the version of the file that they belong to."""

    path: Path
    """The file FILE.part with these bytes."""
    validator: str = ""
    """The strong ETag of the server; without one, nothing is resumed."""
    total_bytes: int = 0
    """Bytes of the whole file; 0 if nothing has arrived."""

    @staticmethod
    def of(path: Path) -> "Part":
        """The part of the file `path` that an earlier try left, or an empty part."""
        part = path.with_name(path.name + ".part")
        try:
            note = json.loads(part.with_name(part.name + ".json").read_text(encoding="utf-8"))
            return Part(part, str(note["validator"]), int(note["total"]))
        except (OSError, ValueError, TypeError, KeyError):
            return Part(part)

    @property
    def arrived_bytes(self) -> int:
        """Number of bytes from which the download can resume."""
        return self.path.stat().st_size if self.validator and self.path.is_file() else 0

    def begin(self) -> None:
        """Record the version of the file before its first byte is written."""
        self.drop()
        self._note.write_text(
            json.dumps({"validator": self.validator, "total": self.total_bytes}), encoding="utf-8"
        )

    def drop(self) -> None:
        """Forget what has arrived."""
        self.path.unlink(missing_ok=True)
        self._note.unlink(missing_ok=True)

    def finish(self, path: Path) -> None:
        """Move the whole file to `path`."""
        self.path.replace(path)
        self._note.unlink(missing_ok=True)

    @property
    def _note(self) -> Path:
        """The file that records the version."""
        return self.path.with_name(self.path.name + ".json")


@dataclass(frozen=True)
class Downloader:
    """Downloads with a number of tries, a timeout and a wait between tries."""

    tries: int
    timeout_s: float
    """How long the server may be silent."""
    wait_s: float
    """Wait before the second try; it doubles with each further try, up to 32 times its length."""

    def length(self, url: str, watch: Progress) -> int:
        """Length in bytes of the file at `url`; raises LogError if the server does not give it."""
        return self._with_retries(url, lambda: self._length(url), watch)

    def fetch(self, url: str, path: Path, watch: Progress) -> None:
        """Download `url` to `path`, which exists only once it is whole.

        `watch` counts chunks of up to CHUNK bytes. Raises LogError for an answer that no other try
        would change, for a full disk, and after the last try; what has arrived is kept for the next
        call.
        """
        self._with_retries(url, lambda: self._resume(url, path, watch), watch)

    def _with_retries(self, url: str, work: Callable[[], Result], watch: Progress) -> Result:
        """The result of `work`, which is tried again after failures that may pass."""
        reason = ""
        unreached_count = 0
        for attempt in range(self.tries):
            if attempt:
                wait_s = self.wait_s * 2 ** min(attempt - 1, MAX_DOUBLINGS)
                watch.tell(f"{url}: {reason}; try {attempt + 1} of {self.tries} in {wait_s:g} s")
                time.sleep(wait_s)
            try:
                return work()
            except exceptions.SSLError as error:
                raise LogError(
                    f"{url}: its certificate is not to be trusted ({_error_line(error)})"
                ) from None
            except (
                TryAgainError,
                exceptions.ConnectionError,
                exceptions.ChunkedEncodingError,
                exceptions.Timeout,
            ) as error:
                reason = _error_line(error)
                cause = getattr(error.args[0], "reason", None) if error.args else None
                if isinstance(cause, NewConnectionError):
                    unreached_count += 1
                if unreached_count == MAX_FAILED_CONNECTIONS:
                    advice = "is there a network, and is the base address right?"
                    raise LogError(f"{url}: cannot be reached ({reason}); {advice}") from None
            # requests raises ValueError for some addresses
            except (exceptions.RequestException, ValueError) as error:
                raise LogError(f"{url}: {_error_line(error)}; is the base address right?") from None
        raise LogError(
            f"{url}: gave up after {self.tries} tries, the last one: {reason}; what has arrived is "
            "kept, call again"
        )

    def _length(self, url: str) -> int:
        with self._answer("HEAD", url, {}) as answer:
            return _content_length(answer)

    def _resume(self, url: str, path: Path, watch: Progress) -> None:
        """Download the missing bytes of a file; raises TryAgainError if some are still missing."""
        part = Part.of(path)
        arrived_bytes = part.arrived_bytes
        is_whole = arrived_bytes and arrived_bytes >= part.total_bytes
        if not is_whole:
            headers: dict[str, str] = {}
            if arrived_bytes:
                headers = {"Range": f"bytes={arrived_bytes}-", "If-Range": part.validator}
            with self._answer("GET", url, headers) as answer:
                part, arrived_bytes = _continued(answer, part, arrived_bytes)
                label = path.name
                if arrived_bytes:
                    label += f" from {100 * arrived_bytes / part.total_bytes:.0f} %"
                _append(answer, part, arrived_bytes, label, watch)
        nbytes = part.path.stat().st_size
        if nbytes != part.total_bytes:
            part.drop()
            raise TryAgainError(f"{nbytes} bytes came of {part.total_bytes}")
        part.finish(path)

    def _answer(self, method: str, url: str, headers: dict[str, str]) -> requests.Response:
        """The answer, after at most MAX_REDIRECTS redirections, never from https to http."""
        address = url
        options: dict[str, Any] = {
            "stream": True,
            "allow_redirects": False,
            "timeout": self.timeout_s,
        }
        for _ in range(MAX_REDIRECTS + 1):
            answer = requests.request(method, address, headers=HEADERS | headers, **options)
            if not answer.is_redirect:
                return _checked(answer)
            answer.close()
            location = answer.headers["Location"]
            allowed_schemes = ("https",) if address.startswith("https:") else ("http", "https")
            address = urljoin(address, location)
            if urlsplit(address).scheme not in allowed_schemes:
                raise LogError(
                    f"{url}: sends us on to {location[:200]}, which is not followed; is the base "
                    "address right?"
                )
        raise LogError(
            f"{url}: sends us on more than {MAX_REDIRECTS} times; is the base address right?"
        )


def _checked(answer: requests.Response) -> requests.Response:
    """An answer of success; raises TryAgainError for one that may pass, LogError for any other."""
    # 416: the part does not fit the file any more, and `_continued` drops it
    if answer.status_code in (200, 206, 416):
        return answer
    answer.close()
    status = f"{answer.status_code} {answer.reason}"
    if answer.status_code in RETRIED_STATUSES:
        raise TryAgainError(status)
    raise LogError(
        f"{answer.url}: the server says {status}; is there such a sequence, and is the base "
        "address right?"
    )


def _continued(answer: requests.Response, part: Part, arrived_bytes: int) -> tuple[Part, int]:
    """The part that an answer continues, and how many of its bytes are on disk."""
    if answer.status_code == 200:
        tag = answer.headers.get("ETag", "")
        is_strong = re.fullmatch('"[^"]*"', tag)
        part = Part(part.path, tag if is_strong else "", _content_length(answer))
        part.begin()
        return part, 0
    expected_range = f"bytes {arrived_bytes}-{part.total_bytes - 1}/{part.total_bytes}"
    is_requested_range = answer.headers.get("Content-Range", "").strip() == expected_range
    is_same_version = answer.headers.get("ETag", part.validator) == part.validator
    is_continuation = answer.status_code == 206 and is_requested_range and is_same_version
    if not arrived_bytes or not is_continuation:
        part.drop()
        raise TryAgainError(
            f"{answer.status_code} {answer.reason}: the server gives another part than was asked "
            "for"
        )
    return part, arrived_bytes


def _append(
    answer: requests.Response, part: Part, arrived_bytes: int, label: str, watch: Progress
) -> None:
    """Append the bytes of an answer to a part, of which `arrived_bytes` are on disk."""
    chunk_count = math.ceil((part.total_bytes - arrived_bytes) / CHUNK)
    try:
        with part.path.open("ab") as file:
            for chunk in watch.track(answer.iter_content(CHUNK), chunk_count, label):
                file.write(chunk)
    except exceptions.RequestException:  # it is an OSError too
        raise
    except OSError as error:
        raise LogError(f"{part.path}: cannot be written ({error.strerror})") from None


def _content_length(answer: requests.Response) -> int:
    """Bytes of the file, by the headers of an answer; raises LogError if they do not say it."""
    length = answer.headers.get("Content-Length", "")
    coding = answer.headers.get("Content-Encoding", "identity")
    if not re.fullmatch("[0-9]{1,15}", length) or coding != "identity":
        reason = (
            "the server does not say how long the file is, so a part cannot be distinguished from "
            "the whole"
        )
        raise LogError(f"{answer.url}: {reason}")
    return int(length)


def _error_line(error: Exception) -> str:
    """The type and the first line of an error."""
    return f"{type(error).__name__}: {error}".splitlines()[0][:200]
