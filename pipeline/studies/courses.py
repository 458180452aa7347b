"""Studies of a localiser that learns further days: orders and strategies.

The strategies are files of conf/strategy.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.studies.study import Study, StudyMethod

SETTING = "rehearsed"
"""A method that has it trains its network further; of others the database grows."""


def instances(
    entry: Mapping[str, Any], study: Study, method: StudyMethod
) -> dict[str, dict[str, Any]]:
    """The instances of the stage `lifelong` for one model: name to entry."""
    dataset = study.name
    learned = {"days": study.learned, "updates": study.updates}
    entries = {}
    for order, strategies in method.courses.items():
        for strategy in strategies:
            course = {
                "order": order,
                "strategy": strategy,
                "learned": " ".join(learned.get(order, ())),
                "asked": " ".join(study.tests),
            }
            entries[f"{dataset}-{entry['grid']}-{entry['model']}-{order}-{strategy}"] = {
                **entry,
                **course,
            }
    return entries


def with_further_days(
    study: Study, defaults: Mapping[str, Any], preset: str, learned: str
) -> Study:
    """The study with the days that it learns after the first, and those left to test.

    `defaults` is the study in the data set's yaml, which tells the days of each preset of a world,
    and those that a site learns by itself. Of a recorded data set every second test sequence is
    learned, unless `learned` names some, with commas between. Raises ConfigError where no day is
    left to learn or to test.
    """
    default = defaults.get("learned", {}).get(preset, study.tests[::2])
    learned_days = learned.split(",") if learned else list(default)
    asked_days = [day for day in study.tests if day not in learned_days]
    if not learned_days or not asked_days:
        raise ConfigError(
            f"learned={','.join(learned_days)}: expected some of several test sequences; the "
            "others are asked after each"
        )
    updates = [day for day in defaults.get("updates", {}).get(preset, ()) if day not in asked_days]
    return replace(
        study, learned=tuple(learned_days), tests=tuple(asked_days), updates=tuple(updates)
    )


def courses(
    defaults: Mapping[str, Any], settings: Mapping[str, Any], updates: bool
) -> dict[str, tuple[str, ...]]:
    """The strategies of each order for a method with these settings."""
    trained = SETTING in settings
    strategies = dict(defaults["trained" if trained else "courses"])
    return {
        order: tuple(strategies[order]) for order in strategies if order != "updates" or updates
    }
