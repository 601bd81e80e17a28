# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One page that tells what was done, how well it went and why: one file that asks no host for anything."""

import base64
import os
from dataclasses import dataclass
from pathlib import Path

from maxcon.atomic import atomic_file
from maxcon.errors import FileError, MissingExtraError

__all__ = ["DemoPage", "MethodSummary", "Picture", "write_demo_page"]


@dataclass(frozen=True, slots=True)
class MethodSummary:
    """How one method did over a drive: a row of the table.

    Parameters
    ----------
    name : str
        The objective or method.
    multiplicity : str
        How a match weighs; empty where the method has none.
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
class Picture:
    """A PNG or SVG, with words.

    Parameters
    ----------
    title, caption : str
        What is written above and below.
    alt : str
        What the picture shows, for those who cannot see it.
    source : path or bytes
        The file, or what is in it.
    """

    title: str
    caption: str
    alt: str
    source: str | os.PathLike[str] | bytes

    @property
    def data_uri(self) -> str:
        """The picture itself, as an address that needs no host.

        Raises
        ------
        FileError
            If the file cannot be read, or is neither a PNG nor an SVG.
        """
        content, name = self._content()
        if content.startswith(b"\x89PNG\r\n\x1a\n"):
            kind = "image/png"
        elif content.lstrip().startswith((b"<?xml", b"<svg")) and b"<svg" in content:
            kind = "image/svg+xml"
        else:
            raise FileError(
                f"Expected {name} to be a PNG or an SVG, got {content[:8]!r}. Draw it as one of these."
            )
        return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"

    def _content(self) -> tuple[bytes, str]:
        """Return the bytes of the picture, and what to call it in a message."""
        if isinstance(self.source, bytes):
            return self.source, f"the picture {self.title!r}"
        try:
            return Path(self.source).read_bytes(), os.fspath(self.source)
        except OSError as error:
            raise FileError(
                f"Expected to read the picture {os.fspath(self.source)}, got: {error.strerror}."
                " Draw it first."
            ) from error


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
    errors, drive : Picture, optional
        Errors over the drive, and the drive from above.
    facts : sequence of (str, str)
        What and how much: ("Map", "4.1 million points").
    command : str
        What to type to get this page again.
    version : str
        Of maxcon.
    seed : int, optional
        That the data were made with.
    """

    title: str
    headline: str
    methods: tuple[MethodSummary, ...]
    epochs: tuple[Picture, ...]
    command: str
    version: str
    seed: int | None = None
    errors: Picture | None = None
    drive: Picture | None = None
    facts: tuple[tuple[str, str], ...] = ()


def check_jinja2() -> None:
    """Say that jinja2 is missing before the work that the page shall tell of.

    Raises
    ------
    MissingExtraError
        If jinja2 is not installed.
    """
    try:
        import jinja2  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "Expected jinja2 to write a page, but it is not installed. Run: pip install 'maxcon[demo]'"
        ) from error


def write_demo_page(path: str | os.PathLike[str], page: DemoPage) -> None:
    """Write a page as one HTML file, pictures inside.

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
    check_jinja2()
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("maxcon.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = _number
    text = environment.get_template("demo.html.j2").render(page=page)
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _number(value: float | None, digits: int) -> str:
    """Return a number for a table; a dash where there is none."""
    return "–" if value is None or value != value else f"{value:,.{digits}f}"
