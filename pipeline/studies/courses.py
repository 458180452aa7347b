"""Courses of a study of lifelong learning: which days a model learns after training, and how.

A course is an order, surveyed days that are `learned` or `updates` that a site learns by itself,
and a strategy, a file of conf/strategy. A preset sets them in a `Study`, `expansion` lists them.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.studies.study import Study, StudyMethod

REHEARSED = "rehearsed"
"""A method with this setting trains its network further; of others the database grows."""


def instances(
    trained: Mapping[str, Any], study: Study, method: StudyMethod
) -> dict[str, dict[str, Any]]:
    """The courses of one model, as instances of the stage `lifelong`: name to settings.

    `trained` are the settings of the model itself, which each instance takes too.
    """
    model = f"{study.name}-{trained['grid']}-{trained['model']}"
    days = {"days": study.learned, "updates": study.updates}
    return {
        f"{model}-{order}-{strategy}": {
            **trained,
            "order": order,
            "strategy": strategy,
            "learned": " ".join(days.get(order, ())),
            "asked": " ".join(study.tests),
        }
        for order, strategies in method.courses.items()
        for strategy in strategies
    }


def with_further_days(
    study: Study, defaults: Mapping[str, Any], preset: str, learned: str
) -> Study:
    """The study with some of its test days learned instead, and the others left to test.

    `learned` names the learned days, with commas between; empty, they are those of `defaults`, the
    study in the data set's yaml, for this preset of a world, or else every second test day. Raises
    ConfigError where no day is left to learn or to test.
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
    """The strategies of each order for a method with these settings.

    `defaults` has those of methods that train further and of others; without `updates` a study has
    no such order.
    """
    trains_further = REHEARSED in settings
    strategies = dict(defaults["trained" if trains_further else "courses"])
    return {
        order: tuple(strategies[order]) for order in strategies if order != "updates" or updates
    }
