"""Downloads one file and resumes it after a broken connection, also in a later process.

The rest of a file is requested by Range and If-Range (HTTP ranges, RFC 9110, section 14), so that a
file that has changed on the server is sent again from its start.
"""

import json
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
AGAIN = (408, 425, 429, 500, 502, 503, 504)
"""Status codes after which another try may succeed."""
REDIRECTS = 5
UNREACHED = 3
"""Number of failed connections after which the address counts as unreachable."""
HEADERS = {"Accept-Encoding": "identity", "User-Agent": "yearloc"}


class TryAgainError(Exception):
    """A failure after which another try may succeed; the text is the reason."""


@dataclass(frozen=True)
class Part:
    """The bytes of a file that have arrived, and the version of the file that they belong to."""

    path: Path
    validator: str = ""
    """The strong ETag of the server; without one, nothing is resumed."""
    total: int = 0

    @staticmethod
    def of(path: Path) -> "Part":
        """The part of the file `path` that an earlier try has left."""
        part = path.with_name(path.name + ".part")
        try:
            note = json.loads(part.with_name(part.name + ".json").read_text(encoding="utf-8"))
            return Part(part, str(note["validator"]), int(note["total"]))
        except (OSError, ValueError, TypeError, KeyError):
            return Part(part)

    @property
    def arrived(self) -> int:
        """Number of bytes from which the download can resume."""
        return self.path.stat().st_size if self.validator and self.path.is_file() else 0

    def begin(self) -> None:
        """Record the version of the file before its first byte is written."""
        self.drop()
        self._note.write_text(
            json.dumps({"validator": self.validator, "total": self.total}), encoding="utf-8"
        )

    def drop(self) -> None:
        self.path.unlink(missing_ok=True)
        self._note.unlink(missing_ok=True)

    def finish(self, path: Path) -> None:
        self.path.replace(path)
        self._note.unlink(missing_ok=True)

    @property
    def _note(self) -> Path:
        return self.path.with_name(self.path.name + ".json")


@dataclass(frozen=True)
class Downloader:
    """Downloads with a number of tries, a timeout and a wait between tries."""

    tries: int
    timeout_s: float
    wait_s: float
    """Wait before the second try; it doubles with each further try, up to 32 times."""

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
        why = ""
        unreached = 0
        for attempt in range(self.tries):
            if attempt:
                wait_s = self.wait_s * 2 ** min(attempt - 1, 5)
                watch.tell(f"{url}: {why}; try {attempt + 1} of {self.tries} in {wait_s:g} s")
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
                why = _error_line(error)
                unreached += isinstance(
                    getattr(next(iter(error.args), None), "reason", None), NewConnectionError
                )
                if unreached == UNREACHED:
                    advice = "is there a network, and is the base address right?"
                    raise LogError(f"{url}: cannot be reached ({why}); {advice}") from None
            except (
                exceptions.RequestException,
                ValueError,
            ) as error:  # requests raises ValueError for some addresses
                raise LogError(f"{url}: {_error_line(error)}; is the base address right?") from None
        raise LogError(
            f"{url}: gave up after {self.tries} tries, the last one: {why}; what has arrived is "
            "kept, call again"
        )

    def _length(self, url: str) -> int:
        with self._answer("HEAD", url, {}) as answer:
            return _length(answer)

    def _resume(self, url: str, path: Path, watch: Progress) -> None:
        part = Part.of(path)
        arrived = part.arrived
        headers = {"Range": f"bytes={arrived}-", "If-Range": part.validator} if arrived else {}
        if arrived < part.total or not arrived:
            with self._answer("GET", url, headers) as answer:
                part, arrived = _continued(answer, part, arrived)
                label = (
                    path.name
                    if not arrived
                    else f"{path.name} from {100 * arrived / part.total:.0f} %"
                )
                chunks = answer.iter_content(CHUNK)
                try:
                    with part.path.open("ab") as file:
                        for chunk in watch.track(
                            chunks, -(-(part.total - arrived) // CHUNK), label
                        ):
                            file.write(chunk)
                except exceptions.RequestException:  # it is an OSError too
                    raise
                except OSError as error:
                    raise LogError(f"{part.path}: cannot be written ({error.strerror})") from None
        nbytes = part.path.stat().st_size
        if nbytes != part.total:
            part.drop()
            raise TryAgainError(f"{nbytes} bytes came of {part.total}")
        part.finish(path)

    def _answer(self, method: str, url: str, headers: dict[str, str]) -> requests.Response:
        """The answer after at most REDIRECTS redirections.

        They may lead only to http(s), and never from https to http.
        """
        at = url
        for _ in range(REDIRECTS + 1):
            options: dict[str, Any] = {
                "stream": True,
                "allow_redirects": False,
                "timeout": self.timeout_s,
            }
            answer = requests.request(method, at, headers=HEADERS | headers, **options)
            if not answer.is_redirect:
                return _checked(answer)
            answer.close()
            to = answer.headers["Location"]
            before = at
            at = urljoin(at, to)
            if urlsplit(at).scheme not in (
                ("https",) if before.startswith("https:") else ("http", "https")
            ):
                raise LogError(
                    f"{url}: sends us on to {to[:200]}, which is not followed; is the base address "
                    "right?"
                )
        raise LogError(
            f"{url}: sends us on more than {REDIRECTS} times; is the base address right?"
        )


def _checked(answer: requests.Response) -> requests.Response:
    if answer.status_code in (200, 206, 416):
        return answer
    answer.close()
    status = f"{answer.status_code} {answer.reason}"
    if answer.status_code in AGAIN:
        raise TryAgainError(status)
    raise LogError(
        f"{answer.url}: the server says {status}; is there such a sequence, and is the base "
        "address right?"
    )


def _continued(answer: requests.Response, part: Part, arrived: int) -> tuple[Part, int]:
    """The part that the answer continues, and its bytes on disk: 0 for a whole file.

    Raises TryAgainError for an answer that does not continue what has arrived.
    """
    if answer.status_code == 200:
        tag = answer.headers.get("ETag", "")
        part = Part(part.path, tag if re.fullmatch('"[^"]*"', tag) else "", _length(answer))
        part.begin()
        return part, 0
    fits = (
        answer.headers.get("Content-Range", "").strip()
        == f"bytes {arrived}-{part.total - 1}/{part.total}"
    )
    if not (
        arrived
        and answer.status_code == 206
        and fits
        and answer.headers.get("ETag", part.validator) == part.validator
    ):
        part.drop()
        raise TryAgainError(
            f"{answer.status_code} {answer.reason}: the server gives another part than was asked "
            "for"
        )
    return part, arrived


def _length(answer: requests.Response) -> int:
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
    return f"{type(error).__name__}: {error}".splitlines()[0][:200]
