"""Courses of a study of lifelong learning: which days a model learns after training, and how.

A course is an order and a strategy. The order says what is learned step by step: surveyed days, or
updates, which are days that a site learns by its own poses. The strategy, a file of conf/strategy,
says how, such as growing the database. `proposal` chooses the courses of a study, and `expansion`
makes an instance of the stage `lifelong` of each.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.studies.study import Study, StudyMethod

REHEARSED = "rehearsed"
"""A method with this setting trains its network further; any other only grows its database."""


def instances(
    model_settings: Mapping[str, Any], study: Study, method: StudyMethod
) -> dict[str, dict[str, Any]]:
    """The courses of one model, as instances of the stage `lifelong`: name to settings.

    `model_settings` are the settings of the model itself, which each instance takes too.
    """
    model = f"{study.name}-{model_settings['grid']}-{model_settings['model']}"
    days_of_order = {"days": study.learned, "updates": study.updates}
    courses_of_model = {}
    for order, strategies in method.courses.items():
        for strategy in strategies:
            courses_of_model[f"{model}-{order}-{strategy}"] = {
                **model_settings,
                "order": order,
                "strategy": strategy,
                "learned": " ".join(days_of_order.get(order, ())),
                "asked": " ".join(study.tests),
            }
    return courses_of_model


def with_further_days(
    study: Study, defaults: Mapping[str, Any], preset: str, learned: str
) -> Study:
    """The study in which a model learns some of the test days, and is asked about the others.

    `learned` names the learned days, with commas between. If it is empty they are those that
    `defaults`, the study in the data set's yaml, has for this preset of a world, or else every
    second test day. Raises ConfigError if no day is left to learn or to ask about.
    """
    default_days = defaults.get("learned", {}).get(preset, study.tests[::2])
    learned_days = learned.split(",") if learned else list(default_days)
    asked_days = [day for day in study.tests if day not in learned_days]
    if not learned_days or not asked_days:
        raise ConfigError(
            f"learned={','.join(learned_days)}: expected some of several test sequences; the "
            "others are asked after each"
        )
    # a day that is asked about must not be learned
    updates = [day for day in defaults.get("updates", {}).get(preset, ()) if day not in asked_days]
    return replace(
        study, learned=tuple(learned_days), tests=tuple(asked_days), updates=tuple(updates)
    )


def courses(
    defaults: Mapping[str, Any], settings: Mapping[str, Any], has_updates: bool
) -> dict[str, tuple[str, ...]]:
    """The strategies of each order for a method with these settings of its yaml.

    `defaults` has two tables: `trained` for methods that train further, and `courses` for others.
    The order `updates` is left out unless the study has such days (`has_updates`).
    """
    trains_further = REHEARSED in settings
    strategies_of_orders = defaults["trained" if trains_further else "courses"]
    return {
        order: tuple(strategies)
        for order, strategies in strategies_of_orders.items()
        if order != "updates" or has_updates
    }
