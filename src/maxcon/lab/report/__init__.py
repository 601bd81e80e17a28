"""Pages of studies and of the demo, in one HTML file each with their pictures; they need ``maxcon[demo]``."""

import base64
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Self

from maxcon._system.atomic import atomic_file
from maxcon.errors import needs_extra


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG or SVG with its title, its caption, and what it shows for those who cannot see it (alt)."""

    title: str
    caption: str
    alt: str
    path: Path

    @classmethod
    def of(cls, name: str, path: Path, **values: object) -> Self:
        """Return a picture with the words of that name in `words.toml`, and values in them."""
        title, caption, alt = (page_words()[name][part].format(**values) for part in ("title", "caption", "alt"))
        return cls(title, caption, alt, path)

    @property
    def data_uri(self) -> str:
        """The picture as a data URI, to be embedded in a page."""
        kind = {".png": "image/png", ".svg": "image/svg+xml"}[self.path.suffix]
        return f"data:{kind};base64,{base64.b64encode(self.path.read_bytes()).decode('ascii')}"


@cache
def page_words() -> dict[str, Any]:
    """Return the words of pictures, of tables and of claims (`words.toml`)."""
    return tomllib.loads(resources.files(__name__).joinpath("words.toml").read_text(encoding="utf-8"))


def check_jinja2() -> Any:
    """Return jinja2, or say that it is missing, before the work whose result the page is to show."""
    with needs_extra("jinja2", "to write a page", "demo"):
        import jinja2
    return jinja2


def write_page(path: str | os.PathLike[str], template: str, page: Mapping[str, Any]) -> None:
    """Write a page as one HTML file; its template refers to all values as `page`, and all of them are escaped."""
    jinja2 = check_jinja2()
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
