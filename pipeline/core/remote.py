"""Reads the files of artifacts from a local folder or, as s3://BUCKET/KEY, from an object store.

The store's keys and address come from the environment, as in every S3 program: AWS_ACCESS_KEY_ID,
AWS_SECRET_ACCESS_KEY, and AWS_ENDPOINT_URL for a store that is not Amazon's.
"""

from pathlib import Path
from typing import Any

from pipeline.core.errors import ArtifactError, needed

S3 = "s3://"
"""The beginning of a path in an object store."""
PATIENCE = {"connect_timeout": 5, "read_timeout": 10, "retries": {"total_max_attempts": 1}}
"""Seconds and attempts of botocore, which makes the requests; s3fs above it tries again."""


def is_remote(path: str | Path) -> bool:
    """Whether a path is one in an object store."""
    return isinstance(path, str) and path.startswith(S3)


def content(path: str | Path) -> bytes:
    """Read a file of an artifact, local or in the object store."""
    return bytes(_store().cat_file(path)) if is_remote(path) else Path(path).read_bytes()


def matching_files(folder: str | Path, pattern: str) -> list[str] | list[Path]:
    """The files below an artifact's folder that match a pattern of `Path.glob`, sorted."""
    if is_remote(folder):
        return [f"{S3}{key}" for key in sorted(_store().glob(f"{folder}/{pattern}"))]
    return sorted(Path(folder).glob(pattern))


def look(url: str) -> None:
    """Check that the bucket or key exists.

    Raises ArtifactError if it does not, or if the store refuses or does not answer, and
    NotInstalledError without the extra `s3`.
    """
    with needed("s3", "36 MB"):
        store = _store()
        from botocore.exceptions import BotoCoreError, NoCredentialsError
    try:
        store.info(url)
    except FileNotFoundError as error:
        raise ArtifactError(f"{url}: not in the object store ({error})") from None
    except (PermissionError, NoCredentialsError) as error:
        raise ArtifactError(
            f"{url}: the object store refuses these keys ({error}); set AWS_ACCESS_KEY_ID and "
            "AWS_SECRET_ACCESS_KEY"
        ) from None
    except (OSError, ValueError, BotoCoreError) as error:
        raise ArtifactError(
            f"{url}: the object store does not answer ({error}); set AWS_ENDPOINT_URL"
        ) from None


def _store() -> Any:
    """Connect to the object store that the environment names."""
    import s3fs

    store = s3fs.S3FileSystem(config_kwargs=PATIENCE, skip_instance_cache=True)
    store.retries = 2  # fewer attempts than s3fs makes by itself, so that an error comes soon
    return store
