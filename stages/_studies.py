"""The studies that the stages behind `evaluate` look up by name."""

from collections.abc import Mapping
from typing import Any

import yaml

from pipeline.studies.expansion import checked
from stages import ROOT


def studies() -> Mapping[str, Any]:
    """The studies of conf/studies.yaml; raises ConfigError where conf/lists.yaml does not follow from them."""
    found, lists = (yaml.safe_load((ROOT / "conf" / f"{name}.yaml").read_text())[name] for name in ("studies", "lists"))
    return checked(found, lists)
