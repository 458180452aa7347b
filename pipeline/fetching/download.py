"""One file from a web server, resumed where it broke off: in this call, or in a later one after this process was killed.

HTTP ranges (RFC 9110, section 14): the rest is asked for with Range and If-Range, so that a file that changed at the server
comes anew instead of being pieced together of two.
"""

import json
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from urllib.parse import urljoin, urlsplit

import requests
from requests import exceptions
from urllib3.exceptions import NewConnectionError

from pipeline.errors import LogError
from pipeline.running.progress import Progress

Result = TypeVar("Result")

CHUNK = 2**16
AGAIN = (408, 425, 429, 500, 502, 503, 504)
"""Answers that may be better a little later."""
REDIRECTS = 5
UNREACHED = 3
"""So often in all may nobody answer at the address before that is final."""
HEADERS = {"Accept-Encoding": "identity", "User-Agent": "yearloc"}


class TryAgainError(Exception):
    """A failure worth another try; says why."""


@dataclass(frozen=True)
class Part:
    """What has arrived of a file, and whose bytes it is."""

    path: Path
    validator: str = ""
    """The server's strong ETag; without one, nothing is resumed."""
    total: int = 0

    @staticmethod
    def of(path: Path) -> "Part":
        """What an earlier try left of the file `path`."""
        part = path.with_name(path.name + ".part")
        try:
            said = json.loads(part.with_name(part.name + ".json").read_text())
            return Part(part, str(said["validator"]), int(said["total"]))
        except (OSError, ValueError, TypeError, KeyError):
            return Part(part)

    @property
    def arrived(self) -> int:
        """Bytes that can be gone on from."""
        return self.path.stat().st_size if self.validator and self.path.is_file() else 0

    def begin(self) -> None:
        """Say whose bytes they are, before the first one is written."""
        self.drop()
        self._note.write_text(json.dumps({"validator": self.validator, "total": self.total}))

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
    """How patiently to ask."""

    tries: int
    timeout_s: float
    wait_s: float
    """Before the second try, doubled at each further one up to 32 times that."""

    def length(self, url: str, watch: Progress) -> int:
        """Bytes of the file at `url`; raises LogError where the server does not say."""
        return self._patiently(url, lambda: self._length(url), watch)

    def fetch(self, url: str, path: Path, watch: Progress) -> None:
        """Bring `url` to `path`, which appears once it is whole; `watch` is shown chunks of up to CHUNK bytes.

        Raises LogError for an answer that no further try would change, for a full disk, and when the tries are used up; what has
        arrived is kept for the next call.
        """
        self._patiently(url, lambda: self._go_on(url, path, watch), watch)

    def _patiently(self, url: str, work: Callable[[], Result], watch: Progress) -> Result:
        why, unreached = "", 0
        for attempt in range(self.tries):
            if attempt:
                wait_s = self.wait_s * 2 ** min(attempt - 1, 5)
                watch.tell(f"{url}: {why}; try {attempt + 1} of {self.tries} in {wait_s:g} s")
                time.sleep(wait_s)
            try:
                return work()
            except exceptions.SSLError as error:
                raise LogError(f"{url}: its certificate is not to be trusted ({_said(error)})") from None
            except (TryAgainError, exceptions.ConnectionError, exceptions.ChunkedEncodingError, exceptions.Timeout) as error:
                why = _said(error)
                unreached += _unreached(error)
                if unreached == UNREACHED:
                    raise LogError(
                        f"{url}: cannot be reached ({why}); is there a network, and is the base address right?"
                    ) from None
            except (exceptions.RequestException, ValueError) as error:  # requests lets some addresses' ValueErrors through
                raise LogError(f"{url}: {_said(error)}; is the base address right?") from None
        raise LogError(f"{url}: gave up after {self.tries} tries, the last one: {why}; what has arrived is kept, call again")

    def _length(self, url: str) -> int:
        with self._answer("HEAD", url, {}) as answer:
            return _length(answer)

    def _go_on(self, url: str, path: Path, watch: Progress) -> None:
        part = Part.of(path)
        arrived = part.arrived
        asked = {"Range": f"bytes={arrived}-", "If-Range": part.validator} if arrived else {}
        if arrived < part.total or not arrived:
            with self._answer("GET", url, asked) as answer:
                part, arrived = _agreed(answer, part, arrived)
                says = path.name if not arrived else f"{path.name} from {100 * arrived / part.total:.0f} %"
                chunks = answer.iter_content(CHUNK)
                try:
                    with part.path.open("ab") as file:
                        for chunk in watch.track(chunks, -(-(part.total - arrived) // CHUNK), says):
                            file.write(chunk)
                except exceptions.RequestException:  # an OSError too
                    raise
                except OSError as error:
                    raise LogError(f"{part.path}: cannot be written ({error.strerror})") from None
        found = part.path.stat().st_size
        if found != part.total:
            part.drop()
            raise TryAgainError(f"{found} bytes came of {part.total}")
        part.finish(path)

    def _answer(self, method: str, url: str, asked: dict[str, str]) -> requests.Response:
        """The answer after redirections, of which only those to http(s) are followed, and none from https to http."""
        at = url
        for _ in range(REDIRECTS + 1):
            answer = requests.request(
                method, at, headers=HEADERS | asked, stream=True, allow_redirects=False, timeout=self.timeout_s
            )
            if not answer.is_redirect:
                return _checked(answer)
            answer.close()
            to = answer.headers["Location"]
            at, before = urljoin(at, to), at
            if urlsplit(at).scheme not in (("https",) if before.startswith("https:") else ("http", "https")):
                raise LogError(f"{url}: sends us on to {to[:200]}, which is not followed; is the base address right?")
        raise LogError(f"{url}: sends us on more than {REDIRECTS} times; is the base address right?")


def _checked(answer: requests.Response) -> requests.Response:
    if answer.status_code in (200, 206, 416):
        return answer
    answer.close()
    said = f"{answer.status_code} {answer.reason}"
    if answer.status_code in AGAIN:
        raise TryAgainError(said)
    raise LogError(f"{answer.url}: the server says {said}; is there such a sequence, and is the base address right?")


def _agreed(answer: requests.Response, part: Part, arrived: int) -> tuple[Part, int]:
    """Whose bytes the answer's are, and how many of them are here: a whole file begins anew, a rest must fit what has arrived."""
    if answer.status_code == 200:
        tag = answer.headers.get("ETag", "")
        part = Part(part.path, tag if re.fullmatch('"[^"]*"', tag) else "", _length(answer))
        part.begin()
        return part, 0
    fits = answer.headers.get("Content-Range", "").strip() == f"bytes {arrived}-{part.total - 1}/{part.total}"
    if not (arrived and answer.status_code == 206 and fits and answer.headers.get("ETag", part.validator) == part.validator):
        part.drop()
        raise TryAgainError(f"{answer.status_code} {answer.reason}: the server gives another part than was asked for")
    return part, arrived


def _length(answer: requests.Response) -> int:
    said, coding = answer.headers.get("Content-Length", ""), answer.headers.get("Content-Encoding", "identity")
    if not re.fullmatch("[0-9]{1,15}", said) or coding != "identity":
        raise LogError(f"{answer.url}: the server does not say how long the file is, so a part could not be told from the whole")
    return int(said)


def _unreached(error: Exception) -> bool:
    """Whether no connection came about at all."""
    cause = getattr(error.args[0], "reason", None) if error.args else None
    return isinstance(cause, NewConnectionError)


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0][:200]
