# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pages of HTML from templates; that of the demo."""

import base64
import os
from dataclasses import dataclass
from pathlib import Path

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, MissingExtraError


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG or SVG, with its title, caption and description.

    title, caption: what is written above and below.
    alt: what the picture shows, for those who cannot see it.
    source: the file, or its content.
    """

    title: str
    caption: str
    alt: str
    source: str | os.PathLike[str] | bytes

    @property
    def data_uri(self) -> str:
        """The picture as a data URI, to be embedded in a page."""
        content, name = self._content()
        if content.startswith(b"\x89PNG\r\n\x1a\n"):
            kind = "image/png"
        elif content.lstrip().startswith((b"<?xml", b"<svg")) and b"<svg" in content:
            kind = "image/svg+xml"
        else:
            raise FileError(f"Expected {name} to be a PNG or an SVG, got {content[:8]!r}. Draw it as one of these.")
        return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"

    def _content(self) -> tuple[bytes, str]:
        """Return the bytes of the picture, and what to call it in a message."""
        if isinstance(self.source, bytes):
            return self.source, f"the picture {self.title!r}"
        try:
            return Path(self.source).read_bytes(), os.fspath(self.source)
        except OSError as error:
            raise FileError(
                f"Expected to read the picture {os.fspath(self.source)}, got: {error.strerror}. Draw it first."
            ) from error


def check_jinja2() -> None:
    """Check that jinja2 is installed, before the work whose result the page is to show."""
    try:
        import jinja2  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "Expected jinja2 to write a page, but it is not installed. Run: pip install 'maxcon[demo]'"
        ) from error


def write_page(path: str | os.PathLike[str], template: str, page: object) -> None:
    """Write a page as one HTML file.

    path: the file to write.
    template: name of the template in `maxcon/report/templates`.
    page: its values, which the template refers to as `page`; all of them are escaped.
    """
    check_jinja2()
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("maxcon.lab.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = _number
    text = environment.get_template(template).render(page=page)
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _number(value: float | None, digits: int) -> str:
    """Return a number for a table; a dash where there is none."""
    return "–" if value is None or value != value else f"{value:,.{digits}f}"


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
