# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tables of a study: one of its methods, and one for each question that some methods were made to answer."""

from collections.abc import Sequence

from maxcon.lab.report.study.page import MethodTable
from maxcon.lab.study import METHOD_SETS, MethodStatistics

__all__ = ["method_tables"]

QUESTIONS: dict[str, tuple[str, str]] = {
    "weights": (
        "Weights of normals",
        "With w = max(0, n_scan · n_map), where a scan point has no normal 0 (published) or 1/2; and with w = 1.",
    ),
    "thinning": (
        "Thinning of the scan",
        "All its points, and one in each cube of 0.25 m (the default) or 0.40 m; every map point counted (points).",
    ),
    "cells": ("Edge of a cell", "The map's voxels and the search's cells together; a voxel counts once."),
    "density": ("Density of the map", "The whole cloud, every fourth and every sixteenth point of it."),
    "ground": (
        "With the ground in the map",
        "A baseline that leans on the ground may have it; maximum consensus gets the same map.",
    ),
}

WITHOUT_GROUND = ("helmert-occupied", "icp-plane-1m", "icp-plane-3m", "gicp-3m")
"""Methods that are shown beside those with the ground in the map."""


def method_tables(prior: str, found: Sequence[MethodStatistics]) -> list[MethodTable]:
    """Return the tables of one prior: that of the methods, and one for each question that the study answers.

    prior: name of the prior.
    found: statistics of all methods.
    """
    by_name = {method.method: method for method in found}
    asked = {name: [by_name[one] for one in METHOD_SETS[name] if one in by_name] for name in QUESTIONS}
    asked["ground"] += [by_name[name] for name in WITHOUT_GROUND if name in by_name]
    only_asked = {
        name for question in QUESTIONS for name in METHOD_SETS[question] if name not in METHOD_SETS["consensus"]
    }
    plain = [method for method in found if method.method not in only_asked]
    tables = []
    if plain:
        tables.append(MethodTable(f"Methods, prior “{prior}”", "", tuple(plain)))
    for name, (title, words) in QUESTIONS.items():
        if any(method.method in only_asked for method in asked[name]):
            tables.append(MethodTable(f"{title}, prior “{prior}”", words, tuple(asked[name])))
    return tables
