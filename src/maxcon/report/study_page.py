# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the page of a study shows: claims, tables, pictures; nouns for its template."""

import math
import os
from dataclasses import dataclass

from maxcon.report.claims import Claim
from maxcon.report.html import Picture, write_page
from maxcon.study import MethodStatistics

__all__ = ["MethodTable", "StudyPage", "write_study_page"]


@dataclass(frozen=True, slots=True)
class MethodTable:
    """How methods did with one prior.

    Parameters
    ----------
    title, words : str
        What is compared, and how to read it.
    methods : tuple of MethodStatistics
        A row each.
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
class StudyPage:
    """Everything the page of a study shows; all of it is escaped.

    Parameters
    ----------
    title, headline : str
        What was studied, and what came out, in a sentence or two.
    facts : tuple of (str, str)
        What and how much.
    claims : tuple of Claim
        The paper beside this study.
    tables : tuple of MethodTable
        At least one.
    scenes, statistics : tuple of Picture
        Figures of single epochs, and of all epochs.
    notes : tuple of str
        What the page lacks, and why.
    reasons : tuple of (str, int)
        Why epochs have no answer, and how many rows each reason has.
    command : str
        What to type to get this page again.
    configuration : str
        What ran, as it was saved.
    version : str
        Of maxcon.
    """

    title: str
    headline: str
    facts: tuple[tuple[str, str], ...]
    claims: tuple[Claim, ...]
    tables: tuple[MethodTable, ...]
    scenes: tuple[Picture, ...]
    statistics: tuple[Picture, ...]
    notes: tuple[str, ...]
    reasons: tuple[tuple[str, int], ...]
    command: str
    configuration: str
    version: str


def write_study_page(path: str | os.PathLike[str], page: StudyPage) -> None:
    """Write the page of a study as one HTML file, pictures inside.

    Raises
    ------
    MissingExtraError
        If jinja2 is not installed.
    FileError
        If a picture cannot be read or the page cannot be written.
    """
    write_page(path, "study.html.j2", page)
