"""The data dictionary goes on: the artifact of the stage `lifelong`."""

from pipeline.store import Column, Schema

LIFELONG = Schema(
    "lifelong",
    2,
    {
        "right": Column("?", ("step", "query"), "the first answer is the query's cell", 8, 8),
        "error_m": Column(
            "f8", ("step", "query"), "distance from the query to the first answer", 8, 8
        ),
        "known_from": Column(
            "i8", ("query",), "the step from which its cell was surveyed; −1 for never"
        ),
        "day": Column("i8", ("query",), "index of the asked day"),
        "xy_m": Column("f8", ("query", "xy"), "where the query was taken"),
        "place_xy_m": Column(
            "f8", ("place", "xy"), "centre of each cell surveyed by the last step"
        ),
        "newest_ns": Column(
            "i8", ("place",), "stamp of its newest view that was surveyed or adopted"
        ),
    },
    {
        "order": "days, streets or updates: what is learned in each step",
        "strategy": "what a model does with it: a file of conf/strategy",
        "steps": "name of each step",
        "asked": "name of each asked day",
        "newest_ns": "stamp of the newest view after each step",
        "asked_ns": "first stamp of each asked day",
        "correct_m": "right by distance: the answer is at most so far away",
        "places": "cells surveyed by each step",
        "bytes": "of the model after each step",
        "counts": (
            "of each update: scans asked and adopted, adopted at a wrong pose, submaps that changed"
        ),
    },
)
