"""The studies that the stages behind `evaluate` look up by name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pipeline.studies.expansion import checked


def studies(conf: Path) -> Mapping[str, Any]:
    """The studies of studies.yaml in conf/; raises ConfigError where lists.yaml does not follow from them."""
    found, lists = (yaml.safe_load((conf / f"{name}.yaml").read_text())[name] for name in ("studies", "lists"))
    return checked(found, lists)
