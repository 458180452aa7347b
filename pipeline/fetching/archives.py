"""Fetches the official archives of a data set: a publisher's yaml in, folders for a reader out.

A file of conf/fetch names the publisher's server and the archives of a sequence. For each archive
that is not there yet, `Publisher.fetch`

1. checks that the disk has room for it,
2. downloads it, or resumes an unfinished download (`download`),
3. compares its sha256 with the publisher's, or with that of an earlier fetch,
4. unpacks it into the folder of the sequence (`unpacking`) and removes it, or moves it there.

Below the root, archives/ holds unfinished downloads (.part, and .part.json with the server's ETag)
and the sha256 of each finished file.
"""

import hashlib
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import urljoin, urlsplit

from filelock import FileLock, Timeout

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, checked
from pipeline.fetching.download import Downloader, Part
from pipeline.fetching.unpacking import unpack


@dataclass(frozen=True)
@checked("archives")
class Archive:
    """An entry of `archives` in conf/fetch: one file of each sequence, or a numbered series.

    {sequence} in path and target stands for the sequence's name, {number} for the number of a
    file in the series.
    """

    path: str
    """Path below the base address."""
    target: str
    """The file or folder in the sequence's folder that exists once the archive is fetched, and
    unpacked if it is a .tar.gz."""
    unpacked_ratio: Positive = 1.0
    """Estimate of how many bytes it unpacks to, per byte of the file."""
    numbers: int = 0
    """Count of a numbered series, whose {number} is 0, 1, …, numbers − 1; 0 for a single file."""
    nbytes: int = 0
    """Estimate of the bytes of the file; 0 if the server has to be asked."""
    listing_sha256: str = ""
    """sha256 of a text with a line `DIGEST  NAME` for each file of a series, if it is known."""

    def __post_init__(self) -> None:
        if not re.fullmatch("([0-9a-f]{64})?", self.listing_sha256):
            raise ConfigError(
                f"archives.listing_sha256={self.listing_sha256}: expected 64 hexadecimal digits"
            )
        leaves_base = not self.path or self.path[0] == "/" or ".." in self.path
        if leaves_base or not re.fullmatch(r"[\w{}.-]+", self.target):
            raise ConfigError(
                f"archives.path={self.path}, target={self.target}: expected a path below the base "
                "and a name"
            )

    @property
    def name(self) -> str:
        """The file's name."""
        return Path(self.path).name

    @property
    def is_packed(self) -> bool:
        """Whether the file has to be unpacked."""
        return self.name.endswith(".tar.gz")

    def of(self, sequence: str) -> list["Archive"]:
        """The archives of a sequence: one, or one for each number of a series."""

        def fill(template: str, number: int) -> str:
            return template.replace("{sequence}", sequence).replace("{number}", str(number))

        return [
            replace(self, path=fill(self.path, number), target=fill(self.target, number))
            for number in range(max(self.numbers, 1))
        ]


@dataclass(frozen=True)
class Fetch:
    """The archives of one entry for one sequence, and the folder that they go to."""

    folder: Path
    """The sequence's folder."""
    archives: Sequence[Archive]

    @property
    def listing_sha256(self) -> str:
        """See Archive."""
        return self.archives[0].listing_sha256

    @property
    def missing_archives(self) -> list[Archive]:
        """The archives that are not fetched yet."""
        return [archive for archive in self.archives if not (self.folder / archive.target).exists()]

    @property
    def name(self) -> str:
        """The name of the archive, or the first and last of a series: `0.pcd … 1140.pcd`."""
        first = self.archives[0].name
        last = self.archives[-1].name
        return first if first == last else f"{first} … {last}"


@dataclass(frozen=True)
@checked("fetch")
class Publisher:
    """The server of a data set and how to fetch from it: the keys of conf/fetch/NAME.yaml."""

    base: str
    """The base address, below which the archives lie; it ends in /."""
    archives: Sequence[Archive]
    sequence: str = r"\w[\w.+-]*"
    """A regular expression that every sequence's name matches."""
    sequences: Sequence[str] = ()
    """The sequences that are fetched if the command names none."""
    licence: str = ""
    """A text that is printed after fetching, and written to LICENCE.txt beside the data."""
    sha256: Mapping[str, str] = field(default_factory=dict)
    """The sha256 of each path for which the publisher gives one."""
    tries: Count = 20
    """How often the download of one file is tried."""
    timeout_s: Positive = 60.0
    """How long the server may be silent."""
    wait_s: Positive = 1.0
    """Wait before the second try; it doubles with each further one."""

    def __post_init__(self) -> None:
        if urlsplit(self.base).scheme not in ("http", "https") or not self.base.endswith("/"):
            raise ConfigError(f"fetch.base={self.base}: expected an address http(s)://…/")
        try:
            re.compile(self.sequence)
        except re.error as error:
            raise ConfigError(
                f"fetch.sequence={self.sequence}: expected a regular expression ({error})"
            ) from None
        for path, digest in self.sha256.items():
            if not re.fullmatch("[0-9a-f]{64}", str(digest)):
                raise ConfigError(f"fetch.sha256.{path}: expected 64 hexadecimal digits")

    @staticmethod
    def of(conf: Mapping[str, Any]) -> "Publisher":
        """The publisher from the content of a yaml.

        Raises ConfigError for an unknown or missing key.
        """
        try:
            archives = [Archive(**archive) for archive in conf["archives"]]
            return Publisher(**{**conf, "archives": archives})
        except (TypeError, KeyError, AttributeError) as error:
            raise ConfigError(
                f"conf/fetch: {error}; expected base, archives (path, target, unpacked_ratio) and "
                "optional keys"
            ) from None

    def fetch(self, root: Path, sequences: Sequence[str], watch: Progress) -> Iterator[str]:
        """Fetch the missing archives of `sequences` into `root`, yielding lines on the progress.

        Raises ConfigError for an invalid name of a sequence, and LogError for errors of the server
        (after all tries), the disk or an archive; what has arrived is kept for the next call.
        """
        for sequence in sequences:
            if not re.fullmatch(self.sequence, sequence):
                raise ConfigError(f"sequence {sequence}: expected a name like {self.sequence}")
        store = root / "archives"
        try:
            store.mkdir(parents=True, exist_ok=True)
            with FileLock(store / ".lock", timeout=0):
                yield from self._fetch(root, store, list(dict.fromkeys(sequences)), watch)
                if self.licence:
                    (root / "LICENCE.txt").write_text(
                        f"{self.licence}\nFrom {self.base}\n", encoding="utf-8"
                    )
                    yield self.licence
        except Timeout:
            raise LogError(f"{store}: another fetch is at work there; wait for it") from None
        except OSError as error:
            raise LogError(f"{store}: cannot be written ({error})") from None

    def _fetch(
        self, root: Path, store: Path, sequences: Sequence[str], watch: Progress
    ) -> Iterator[str]:
        """Fetch the missing archives through the folder `store`; yields a line per entry."""
        downloader = Downloader(self.tries, self.timeout_s, self.wait_s)
        fetches = [
            Fetch(root / sequence, archive.of(sequence))
            for sequence in sequences
            for archive in self.archives
        ]
        # listed before the first is fetched: the disk is checked for all of them
        missing_by_fetch = [fetch.missing_archives for fetch in fetches]
        all_missing = list(chain.from_iterable(missing_by_fetch))
        self._check_disk(downloader, store, all_missing, watch)
        for fetch, missing_archives in zip(fetches, missing_by_fetch, strict=True):
            if not missing_archives:
                yield f"{fetch.name}: here already"
                continue
            nbytes = 0
            file_count = 0
            for archive in missing_archives:
                path = store / archive.name
                if not path.is_file():
                    downloader.fetch(urljoin(self.base, archive.path), path, watch)
                nbytes += path.stat().st_size
                digest = self._verified_digest(path, archive)
                file_count += _move_in(path, archive, fetch.folder, digest)
            if fetch.listing_sha256:
                digest = _listing_digest(store, fetch)
            size = f"{nbytes / 1e6:,.1f} MB, files: {file_count:,}"
            yield f"{fetch.name}: {size}, sha256 {digest[:16]}…"

    def _check_disk(
        self, downloader: Downloader, store: Path, archives: Sequence[Archive], watch: Progress
    ) -> None:
        """Raise LogError unless the disk has room for all unpacked and the largest one packed."""
        unpacked_bytes = 0.0
        packed_bytes = 0
        for archive in archives:
            path = store / archive.name
            part = Part.of(path)
            arrived_bytes = part.arrived_bytes
            total_bytes = part.total_bytes or archive.nbytes
            if path.is_file():
                arrived_bytes = total_bytes = path.stat().st_size
            if not total_bytes:
                total_bytes = downloader.length(urljoin(self.base, archive.path), watch)
            unpacked_bytes += total_bytes * archive.unpacked_ratio
            if archive.is_packed:
                packed_bytes = max(packed_bytes, total_bytes - arrived_bytes)
        needed_bytes = unpacked_bytes + packed_bytes
        free_bytes = shutil.disk_usage(store).free
        if needed_bytes > free_bytes:
            raise LogError(
                f"{store}: the {len(archives)} files and what they unpack to need about "
                f"{needed_bytes / 1e9:.1f} GB, {free_bytes / 1e9:.1f} GB are free; make room, or "
                "fetch fewer sequences at a time"
            )

    def _verified_digest(self, path: Path, archive: Archive) -> str:
        """The sha256 of a downloaded file; a file of another than is expected is removed."""
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        expected_digest = digest
        source = str(checksum_file(path))
        if archive.path in self.sha256:
            expected_digest = self.sha256[archive.path]
            source = "fetch.sha256"
        elif checksum_file(path).is_file():
            words = checksum_file(path).read_text(encoding="utf-8").split()
            expected_digest = words[0] if words else digest
        if digest != expected_digest:
            path.unlink()
            raise LogError(
                f"{path}: its sha256 is {digest}, {source} says {expected_digest}; damaged, or "
                "changed by its publisher: it is removed, fetch it again"
            )
        return digest


def _move_in(path: Path, archive: Archive, folder: Path, digest: str) -> int:
    """Unpack or move an archive into a sequence's folder; returns how many files it has become."""
    folder.mkdir(exist_ok=True)
    file_count = unpack(path, folder, archive.target) if archive.is_packed else 1
    checksum_file(path).write_text(f"{digest}  {archive.name}\n", encoding="utf-8")
    if archive.is_packed:
        path.unlink()
    else:
        path.replace(folder / archive.target)
    return file_count


def _listing_digest(store: Path, fetch: Fetch) -> str:
    """The sha256 of the lines `DIGEST  NAME` of a series; a wrong one removes the files."""
    digests = {
        archive.name: hashlib.sha256((fetch.folder / archive.target).read_bytes()).hexdigest()
        for archive in fetch.archives
    }
    listing = "".join(f"{file_digest}  {name}\n" for name, file_digest in digests.items())
    digest = hashlib.sha256(listing.encode()).hexdigest()
    if digest != fetch.listing_sha256:
        for archive in fetch.archives:
            checksum_file(store / archive.name).unlink(missing_ok=True)
            (fetch.folder / archive.target).unlink()
        raise LogError(
            f"{fetch.folder}: {fetch.name} have the sha256 {digest}, expected "
            f"{fetch.listing_sha256}; removed, fetch them again"
        )
    return digest


def checksum_file(path: Path) -> Path:
    """The file with the sha256 of an archive, in the format of `sha256sum -c`."""
    return path.with_name(path.name + ".sha256")
