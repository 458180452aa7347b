"""Studies of a localiser that learns further days: orders and strategies.

The strategies are files of conf/strategy.
"""

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
    entries = {}
    for order, strategies in method["courses"].items():
        reads_scans = order == "updates"  # its scans are localised, and so read
        drives = {
            kind: f"artifacts/{kind}/{dataset}" if reads_scans else instead[substitute]
            for kind, substitute in INSTEAD_OF.items()
        }
        learned = " ".join(study.get({"days": "learned"}.get(order, order), ()))
        for strategy in strategies:
            course = {
                "order": order,
                "strategy": strategy,
                "learned": learned,
                "asked": " ".join(study["tests"]),
            }
            entries[f"{dataset}-{entry['grid']}-{entry['model']}-{order}-{strategy}"] = {
                **entry,
                **course,
                **drives,
            }
    return entries


INSTEAD_OF = {"scans": "viewed", "submaps": "changed"}


def further_days(
    study: Mapping[str, Any], options: Mapping[str, str], preset: str, tests: list[str]
) -> dict[str, list[str]]:
    """The days that a study learns after the first, those learned by itself, and its test days.

    Of a recorded data set every second test sequence is learned, unless `learned` says which.
    Raises ConfigError where no day is left to learn or to test.
    """
    default = study.get("learned", {}).get(preset, tests[::2])
    learned = options["learned"].split(",") if "learned" in options else list(default)
    asked_days = [day for day in tests if day not in learned]
    if not learned or not asked_days:
        raise ConfigError(
            f"learned={','.join(learned)}: expected some of several test sequences; the others are "
            "asked after each"
        )
    updates = [day for day in study.get("updates", {}).get(preset, ()) if day not in asked_days]
    return {"learned": learned, "tests": asked_days} | ({"updates": updates} if updates else {})


def courses(
    study: Mapping[str, Any], settings: Mapping[str, Any], updates: bool
) -> dict[str, list[str]]:
    """The strategies of each order for a method with these settings."""
    trained = SETTING in settings
    strategies = dict(study["trained" if trained else "courses"])
    return {order: list(strategies[order]) for order in strategies if order != "updates" or updates}
