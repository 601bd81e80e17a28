# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page of a study: its sections and tables."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

from maxcon.lab.evaluation import PROMISED, PROMISED_PLANE, Coverage, MeanSquare, ProtectionCounts, least_to_prove
from maxcon.lab.report.pages import Picture, write_page
from maxcon.lab.report.study_claims import Claim
from maxcon.lab.study import METHOD_SETS, MethodStatistics


@dataclass(frozen=True, slots=True)
class MethodTable:
    """How methods did with one prior.

    title, words: what is compared, and how to read it.
    methods: a row each.
    """

    title: str
    words: str
    methods: tuple[MethodStatistics, ...]

    @property
    def has_distinctness(self) -> bool:
        """Whether any method has measures of distinctness."""
        return any(not math.isnan(method.kurtosis) for method in self.methods)

    @property
    def has_starts(self) -> bool:
        """Whether any method has several starts."""
        return any(method.n_starts for method in self.methods)


@dataclass(frozen=True, slots=True)
class CoverageRow:
    """How many errors of one kind lie within their predicted sigmas.

    name: kind of error.
    coverage: the counts.
    n_errors: number of errors taken together: 2 for x and y within ellipses.
    """

    name: str
    coverage: Coverage
    n_errors: int = 1

    @property
    def promised(self) -> tuple[float, ...]:
        """Shares within 1, 2 and 3 sigma, 0 to 1, that are expected if the sigmas hold."""
        return PROMISED if self.n_errors == 1 else PROMISED_PLANE

    @property
    def promised_rms(self) -> float:
        """Root of the mean square of errors over sigmas that is expected if the sigmas hold."""
        return math.sqrt(self.n_errors)

    @property
    def verdict(self) -> str:
        """Whether sigmas are too small, too large or as promised, by the 95 % intervals of the three shares."""
        ends = list(zip(self.coverage.intervals, self.promised, strict=True))
        if any(high < promised for (_, high), promised in ends):
            return "too small"
        return "too large" if any(low > promised for (low, _), promised in ends) else "as promised"


@dataclass(frozen=True, slots=True)
class CoverageTable:
    """How well a method knows its errors.

    title: which method and prior.
    rows: at least one.
    squares: of x and y together.
    """

    title: str
    rows: tuple[CoverageRow, ...]
    squares: MeanSquare


@dataclass(frozen=True, slots=True)
class ProtectionTable:
    """How often errors exceed a method's protection levels, and what that proves.

    title: which method and prior.
    rows: by direction.
    risk: how often the method says that its levels are exceeded, 0 to 1, if it says so.
    """

    title: str
    rows: tuple[tuple[str, ProtectionCounts], ...]
    risk: float | None

    @property
    def n_to_prove(self) -> int | None:
        """Epochs that, none of them beyond its level, would prove the stated risk."""
        return None if self.risk is None else least_to_prove(self.risk)


@dataclass(frozen=True, slots=True)
class Certainty:
    """How certain a study's methods say they are, against their true errors.

    coverage: errors within predicted sigmas.
    protection: errors within protection levels.
    alert_limit: alert limit of the protection tables, m.
    coverage_pictures, protection_pictures: pictures that belong to these tables.
    status_pictures: pictures of what the status is worth, and of the drive epoch by epoch.
    notes: what is missing, and why.
    """

    coverage: tuple[CoverageTable, ...]
    protection: tuple[ProtectionTable, ...]
    alert_limit: float
    coverage_pictures: tuple[Picture, ...]
    protection_pictures: tuple[Picture, ...]
    status_pictures: tuple[Picture, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StudyPage:
    """Everything the page of a study shows; all of it is escaped.

    title, headline: what was studied, and what came out, in a sentence or two.
    facts: names and values of what was studied.
    claims: the paper beside this study.
    tables: at least one.
    scenes, statistics: figures of single epochs, and of all epochs.
    certainty: how certain the methods are, and whether their errors bear it out.
    notes: what the page lacks, and why.
    reasons: why epochs have no answer, and how many rows each reason has.
    command: what to type to get this page again.
    configuration: the runs of the study, as it saved them, JSON.
    version: of maxcon.
    """

    title: str
    headline: str
    facts: tuple[tuple[str, str], ...]
    claims: tuple[Claim, ...]
    tables: tuple[MethodTable, ...]
    scenes: tuple[Picture, ...]
    statistics: tuple[Picture, ...]
    certainty: Certainty
    notes: tuple[str, ...]
    reasons: tuple[tuple[str, int], ...]
    command: str
    configuration: str
    version: str


def write_study_page(path: str | os.PathLike[str], page: StudyPage) -> None:
    """Write the page of a study as one HTML file, pictures inside."""
    write_page(path, "study.html.j2", page)


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
