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

    Parameters
    ----------
    name : str
        The objective or method.
    multiplicity : str
        How matches are counted (`occupied`, `points`); empty where the method has no matches.
    n_epochs, n_localized, n_success : int
        Epochs in all, with an answer, and with one within 0.3 m and 1 degree of the reference.
    median_error, worst_error : float, optional
        Distance to the reference over the answers, m; None where there is no answer.
    worst_heading_error_deg : float, optional
        Over the answers, degrees.
    median_ms : float, optional
        Time per epoch, ms.
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

    Parameters
    ----------
    title : str
        Heading of the page.
    headline : str
        What was done and what came out, in a sentence or two.
    methods : sequence of MethodSummary
        Rows of the table.
    epochs : sequence of Picture
        Some epochs: a street by count and by Helmert, a crossing.
    why : Picture, optional
        An epoch where the count is wrong and Helmert's score is not; it comes first.
    errors, drive : Picture, optional
        Errors over the drive, and the drive from above.
    wide : Picture, optional
        How each method does with less and less accurate priors.
    facts : sequence of (str, str)
        Names and values: ("Map", "4.1 million points").
    command : str
        What to type to get this page again.
    version : str
        Of maxcon.
    seed : int, optional
        The seed of the simulated data.
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

    Parameters
    ----------
    path : path
        The file to write.
    page : DemoPage
        What it shows.

    Raises
    ------
    MissingExtraError
        If jinja2 is not installed.
    FileError
        If a picture cannot be read or the page cannot be written.
    """
    write_page(path, "demo.html.j2", page)
