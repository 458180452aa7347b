"""Fetches the official archives of a data set.

Downloads are resumed, checked and unpacked into the folders that the reader expects. Below the
root, archives/ holds unfinished downloads (.part, and .part.json with the server's ETag) and the
sha256 of each finished file. An archive is removed once it is unpacked.
"""

import hashlib
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import urljoin, urlsplit

from filelock import FileLock, Timeout

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, check
from pipeline.fetching.download import Downloader, Part
from pipeline.fetching.unpacking import unpack


@dataclass(frozen=True)
class Archive:
    """One file of a sequence on the server of the publisher."""

    path: str
    """Path below the base address."""
    target: str
    """The file or folder in the sequence's folder that exists once the archive is fetched.

    Of a .tar.gz, once it is unpacked.
    """
    unpacked_ratio: Positive = 1.0
    """Estimate of the unpacked bytes per byte."""
    numbers: int = 0
    """How many files: {number} in path and target becomes 0, 1, ….

    0 is a single file.
    """
    nbytes: int = 0
    """Estimate of the bytes of a file, so that the server need not be asked; 0: it is asked."""
    listing_sha256: str = ""
    """sha256 of the lines `DIGEST  NAME` of all numbered files, where the publisher's are known."""

    def __post_init__(self) -> None:
        check(self, "archives")
        if not re.fullmatch("([0-9a-f]{64})?", self.listing_sha256):
            raise ConfigError(
                f"archives.listing_sha256={self.listing_sha256}: expected 64 hexadecimal digits"
            )
        if (
            not self.path
            or self.path[0] == "/"
            or ".." in self.path
            or not re.fullmatch(r"[\w{}.-]+", self.target)
        ):
            raise ConfigError(
                f"archives.path={self.path}, target={self.target}: expected a path below the base "
                "and a name"
            )

    def of(self, sequence: str) -> list["Archive"]:
        """The archives of a sequence: this one, or one for each number."""

        def named(number: int) -> "Archive":
            templates = (self.path, self.target)
            path, target = (
                text.replace("{sequence}", sequence).replace("{number}", str(number))
                for text in templates
            )
            return replace(self, path=path, target=target, numbers=0, listing_sha256="")

        return [named(number) for number in range(max(self.numbers, 1))]

    @property
    def name(self) -> str:
        return Path(self.path).name

    @property
    def packed(self) -> bool:
        return self.name.endswith(".tar.gz")


@dataclass(frozen=True)
class Publisher:
    """The server of a data set and how to fetch from it: the keys of conf/fetch/NAME.yaml."""

    base: str
    archives: Sequence[Archive]
    sequence: str = r"\w[\w.+-]*"
    """A regular expression for the names of sequences, which replace {sequence} in the paths."""
    sequences: Sequence[str] = ()
    """The sequences to fetch where the command names none."""
    licence: str = ""
    """The text printed after fetching, and written to LICENCE.txt beside the data."""
    sha256: Mapping[str, str] = field(default_factory=dict)
    """The sha256 of each path for which the publisher gives one."""
    tries: Count = 20
    timeout_s: Positive = 60.0
    wait_s: Positive = 1.0

    def __post_init__(self) -> None:
        check(self, "fetch")
        if urlsplit(self.base).scheme not in ("http", "https") or not self.base.endswith("/"):
            raise ConfigError(f"fetch.base={self.base}: expected an address http(s)://…/")
        try:
            re.compile(self.sequence)
        except re.error as error:
            raise ConfigError(
                f"fetch.sequence={self.sequence}: expected a regular expression ({error})"
            ) from None
        if bad := [
            path
            for path, digest in self.sha256.items()
            if not re.fullmatch("[0-9a-f]{64}", str(digest))
        ]:
            raise ConfigError(f"fetch.sha256.{bad[0]}: expected 64 hexadecimal digits")

    @staticmethod
    def of(conf: Mapping[str, Any]) -> "Publisher":
        """The publisher from the content of a yaml.

        Raises ConfigError for an unknown or missing key.
        """
        try:
            return Publisher(
                **{**conf, "archives": [Archive(**archive) for archive in conf["archives"]]}
            )
        except (TypeError, KeyError, AttributeError) as error:
            raise ConfigError(
                f"conf/fetch: {error}; expected base, archives (path, target, unpacked_ratio) and "
                "optional keys"
            ) from None

    def fetch(self, root: Path, sequences: Sequence[str], watch: Progress) -> Iterator[str]:
        """Fetch the missing files of `sequences` below `root`, yielding one line per archive.

        What is there already is not fetched again. Raises ConfigError for an invalid sequence, and
        LogError for errors of the server (after all tries), the disk or an archive; what has
        arrived is kept for the next call.
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
        downloader = Downloader(self.tries, self.timeout_s, self.wait_s)
        groups = [
            (root / sequence, group, group.of(sequence))
            for sequence in sequences
            for group in self.archives
        ]
        missing = [
            [archive for archive in archives if not (folder / archive.target).exists()]
            for folder, _, archives in groups
        ]
        self._check_disk(
            downloader, store, [archive for lacking in missing for archive in lacking], watch
        )
        for (folder, group, archives), lacking in zip(groups, missing, strict=True):
            name = (
                f"{archives[0].name} … {archives[-1].name}" if group.numbers else archives[0].name
            )
            if not lacking:
                yield f"{name}: here already"
                continue
            nbytes = 0
            files = 0
            digest = ""
            for archive in lacking:
                path = store / archive.name
                if not path.is_file():
                    downloader.fetch(urljoin(self.base, archive.path), path, watch)
                nbytes = nbytes + path.stat().st_size
                digest = self._verified(path, archive)
                folder.mkdir(exist_ok=True)
                files += unpack(path, folder, archive.target) if archive.packed else 1
                checksum_file(path).write_text(f"{digest}  {archive.name}\n", encoding="utf-8")
                if archive.packed:
                    path.unlink()
                else:
                    path.replace(folder / archive.target)
            digest = (
                self._listing_digest(store, folder, group, archives)
                if group.listing_sha256
                else digest
            )
            yield f"{name}: {nbytes / 1e6:,.1f} MB, files: {files:,}, sha256 {digest[:16]}…"

    def _listing_digest(
        self, store: Path, folder: Path, group: Archive, archives: Sequence[Archive]
    ) -> str:
        """The digest of all numbered files of a group, as they are in `folder`.

        Removes them and raises LogError if it is not the publisher's.
        """
        digests = {
            archive.name: hashlib.sha256((folder / archive.target).read_bytes()).hexdigest()
            for archive in archives
        }
        digest = hashlib.sha256(
            "".join(f"{file_digest}  {name}\n" for name, file_digest in digests.items()).encode()
        ).hexdigest()
        if digest != group.listing_sha256:
            for archive in archives:
                checksum_file(store / archive.name).unlink(missing_ok=True)
                (folder / archive.target).unlink()
            name = f"{archives[0].name} … {archives[-1].name}"
            raise LogError(
                f"{folder}: {name} have the sha256 {digest}, expected {group.listing_sha256}; "
                "removed, fetch them anew"
            )
        return digest

    def _check_disk(
        self, downloader: Downloader, store: Path, archives: Sequence[Archive], watch: Progress
    ) -> None:
        """Raise LogError unless the disk has room for these files.

        It needs room for all of them unpacked, and for the largest archive beside them.
        """
        unpacked_bytes = 0.0
        packed_bytes = 0
        for archive in archives:
            path = store / archive.name
            part = Part.of(path)
            arrived = path.stat().st_size if path.is_file() else part.arrived
            known_bytes = arrived if path.is_file() else part.total or archive.nbytes
            total_bytes = known_bytes or downloader.length(urljoin(self.base, archive.path), watch)
            unpacked_bytes += total_bytes * archive.unpacked_ratio
            packed_bytes = max(packed_bytes, total_bytes - arrived if archive.packed else 0)
        free_bytes = shutil.disk_usage(store).free
        if unpacked_bytes + packed_bytes > free_bytes:
            raise LogError(
                f"{store}: the {len(archives)} files and what they unpack to need about "
                f"{(unpacked_bytes + packed_bytes) / 1e9:.1f} GB, {free_bytes / 1e9:.1f} GB are "
                "free; make room, or fetch fewer sequences at a time"
            )

    def _verified(self, path: Path, archive: Archive) -> str:
        """The sha256 of the file, compared with that of the publisher, or of an earlier fetch.

        Removes the file and raises LogError if they differ.
        """
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        recorded = (
            checksum_file(path).read_text(encoding="utf-8").split()[:1]
            if checksum_file(path).is_file()
            else []
        )
        expected = (recorded or [digest])[0]
        source = str(checksum_file(path))
        if archive.path in self.sha256:
            expected = self.sha256[archive.path]
            source = "fetch.sha256"
        if digest != expected:
            path.unlink()
            raise LogError(
                f"{path}: its sha256 is {digest}, {source} says {expected}; damaged, or changed by "
                "its publisher: it is removed, fetch it anew"
            )
        return digest


def checksum_file(path: Path) -> Path:
    """The file with the sha256 of an archive, in the format of `sha256sum -c`."""
    return path.with_name(path.name + ".sha256")
