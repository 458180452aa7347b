"""Stage `absent`: writes an empty folder in place of a kind of artifacts that a study lacks.

DVC has no optional dependencies. So a stage that can read such artifacts depends on the folder, and
finds it empty.
"""

from dataclasses import dataclass
from pathlib import Path

from pipeline.core.replacing import replace
from stages import stage


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/absent.yaml."""

    out: Path


@stage("absent")
def main(settings: Settings) -> str:
    with replace(settings.out) as folder:
        folder.mkdir()
    return f"{settings.out}: none in this study"


if __name__ == "__main__":
    main()
