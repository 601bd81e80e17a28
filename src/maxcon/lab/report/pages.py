# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pages of HTML from templates, in one file each with their pictures."""

import base64
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, MissingExtraError


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG or SVG, with its title, caption and description.

    title, caption: what is written above and below.
    alt: what the picture shows, for those who cannot see it.
    path: the file.
    """

    title: str
    caption: str
    alt: str
    path: str | os.PathLike[str]

    @property
    def data_uri(self) -> str:
        """The picture as a data URI, to be embedded in a page."""
        try:
            content = Path(self.path).read_bytes()
        except OSError as error:
            raise FileError(
                f"Expected to read the picture {os.fspath(self.path)}, got: {error.strerror}. Draw it first."
            ) from error
        if content.startswith(b"\x89PNG\r\n\x1a\n"):
            kind = "image/png"
        elif content.lstrip().startswith((b"<?xml", b"<svg")) and b"<svg" in content:
            kind = "image/svg+xml"
        else:
            raise FileError(
                f"Expected {os.fspath(self.path)} to be a PNG or an SVG, got {content[:8]!r}. Draw it as one of these."
            )
        return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def check_jinja2() -> None:
    """Check that jinja2 is installed, before the work whose result the page is to show."""
    try:
        import jinja2  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "Expected jinja2 to write a page, but it is not installed. Run: pip install 'maxcon[demo]'"
        ) from error


def write_page(path: str | os.PathLike[str], template: str, page: Mapping[str, Any]) -> None:
    """Write a page as one HTML file.

    path: the file to write.
    template: name of the template in `maxcon/lab/report/templates`: "demo.html.j2" or "study.html.j2".
    page: all values that the template refers to as `page`; all of them are escaped.
    """
    check_jinja2()
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("maxcon.lab.report"), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["number"] = _number
    text = environment.get_template(template).render(page=page)
    with atomic_file(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _number(value: float | None, digits: int) -> str:
    """Return a number for a table; a dash where there is none."""
    return "–" if value is None or value != value else f"{value:,.{digits}f}"
