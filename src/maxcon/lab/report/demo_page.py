# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page of a demo: what was done, how well the methods did, and why."""

import os
from dataclasses import dataclass

from maxcon.lab.report.html import Picture, write_page

__all__ = ["DemoPage", "MethodSummary", "write_demo_page"]


@dataclass(frozen=True, slots=True)
class MethodSummary:
    """How one method did over a drive: a row of the table.

    name: the objective or method.
    multiplicity: how matches are counted (`occupied`, `points`); empty where the method has no matches.
    n_epochs, n_localized, n_success: epochs in all, with an answer, and with one within 0.3 m and 1 degree of the
        reference.
    median_error, worst_error: distance to the reference over the answers, m; None where there is no answer.
    worst_heading_error_deg: over the answers, degrees.
    median_ms: time per epoch, ms.
    """

    name: str
    multiplicity: str
    n_epochs: int
    n_localized: int
    n_success: int
    median_error: float | None
    worst_error: float | None
    worst_heading_error_deg: float | None
    median_ms: float | None


@dataclass(frozen=True, slots=True)
class DemoPage:
    """Everything the page shows; all of it is escaped.

    title: heading of the page.
    headline: what was done and what came out, in a sentence or two.
    methods: rows of the table.
    epochs: some epochs: a street by count and by Helmert, a crossing.
    why: an epoch where the count is wrong and Helmert's score is not; it comes first.
    errors, drive: errors over the drive, and the drive from above.
    wide: how each method does with less and less accurate priors.
    facts: names and values: ("Map", "4.1 million points").
    command: what to type to get this page again.
    version: of maxcon.
    seed: the seed of the simulated data.
    """

    title: str
    headline: str
    methods: tuple[MethodSummary, ...]
    epochs: tuple[Picture, ...]
    command: str
    version: str
    seed: int | None = None
    why: Picture | None = None
    errors: Picture | None = None
    drive: Picture | None = None
    wide: Picture | None = None
    facts: tuple[tuple[str, str], ...] = ()


def write_demo_page(path: str | os.PathLike[str], page: DemoPage) -> None:
    """Write the page as one HTML file, with its pictures inside.

    path: the file to write.
    page: what it shows.
    """
    write_page(path, "demo.html.j2", page)
