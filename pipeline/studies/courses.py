"""Studies of a localiser that learns further days: in which order, and by which strategies (files
of conf/strategy)."""

from collections.abc import Mapping
from typing import Any

from pipeline.errors import ConfigError

LIFELONG = "lifelong"
SETTING = "rehearsed"
"""A method that has it trains its network further; of others the database grows."""


def instances(
    entry: Mapping[str, Any],
    study: Mapping[str, Any],
    method: Mapping[str, Any],
    instead: Mapping[str, str],
) -> Any:
    """The instances of the stage `lifelong` for one model: name to entry."""
    dataset = entry["dataset"]
    found = {}
    for order, strategies in method["courses"].items():
        alone = order == "updates"  # its scans are localised, and so read
        drives = {
            kind: f"artifacts/{kind}/{dataset}" if alone else instead[other]
            for kind, other in USUAL.items()
        }
        learned = " ".join(study.get({"days": "learned"}.get(order, order), ()))
        for strategy in strategies:
            own = {
                "order": order,
                "strategy": strategy,
                "learned": learned,
                "asked": " ".join(study["tests"]),
            }
            found[f"{dataset}-{entry['grid']}-{entry['model']}-{order}-{strategy}"] = {
                **entry,
                **own,
                **drives,
            }
    return found


USUAL = {"scans": "viewed", "submaps": "changed"}


def further_days(
    study: Mapping[str, Any], options: Mapping[str, str], preset: str, tests: list[str]
) -> dict[str, list[str]]:
    """The days that a study learns after the first, those that it learns by itself, and those that
    it asks.

    Of a recorded data set every second test sequence is learned, unless `learned` says which.
    Raises ConfigError where no day is left to learn or to ask.
    """
    usual = study.get("learned", {}).get(preset, tests[::2])
    learned = options["learned"].split(",") if "learned" in options else list(usual)
    asked = [day for day in tests if day not in learned]
    if not learned or not asked:
        raise ConfigError(
            f"learned={','.join(learned)}: expected some of several test sequences; the others are "
            "asked after each"
        )
    updates = [day for day in study.get("updates", {}).get(preset, ()) if day not in asked]
    return {"learned": learned, "tests": asked} | ({"updates": updates} if updates else {})


def courses(
    study: Mapping[str, Any], settings: Mapping[str, Any], updates: bool
) -> dict[str, list[str]]:
    """The strategies of each order for a method with these settings."""
    trained = SETTING in settings
    found = dict(study["trained" if trained else "courses"])
    return {order: list(found[order]) for order in found if order != "updates" or updates}
