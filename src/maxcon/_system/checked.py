"""TOML and JSON files, read within bounds of size and depth, and checked against a msgspec type, with our errors."""

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from maxcon._system.regular_file import read_regular
from maxcon.errors import FileError, MaxconError

T = TypeVar("T")

LARGEST_TOML = 2**20  # bytes; such a file is a page of text
DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){31}""")
"""Keys of as many parts take memory that grows with the square of their length, before anyone looks at them."""


def checked(
    values: object, kind: type[T], where: object, what: str, advice: str, error: type[MaxconError] = FileError
) -> T:
    """Return values read from TOML or JSON as an instance of a `msgspec.Struct` or another type msgspec knows.

    Bounds stand in the type: ``Annotated[float, msgspec.Meta(gt=0)]``. NaN and infinities pass such bounds in one
    direction; give both where they matter. where, what, advice: for messages.
    """
    import msgspec

    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as problem:
        said, _, place = str(problem).partition(" - at `$")
        at = f" at `{place.strip('.`')}`" if place.strip(".`") else ""
        said = said[0].lower() + said[1:]
        raise error(f"Expected {what} in {where}, got another{at}: {said}. {advice}.") from problem


def read_toml(file: Path, what: str, advice: str) -> dict[str, Any]:
    """Return what a TOML file says; FileError, with what was expected and what to do, if it is none or too large."""

    def parsed(content: bytes) -> dict[str, Any]:
        text = content.decode("utf-8")
        if DEEP_KEY.search(text):
            raise ValueError("a key of 32 parts or more")
        return tomllib.loads(text)

    return _read(file, parsed, LARGEST_TOML, what, advice)


def read_json(file: Path, what: str, advice: str, most_bytes: int = 2**30) -> Any:
    """Return what a JSON file says; errors as of `read_toml`."""
    return _read(file, lambda content: json.loads(content.decode("utf-8")), most_bytes, what, advice)


def _read(file: Path, parse: Callable[[bytes], T], most_bytes: int, what: str, advice: str) -> T:
    try:
        content = read_regular(file, most_bytes + 1)
        if len(content) > most_bytes:
            raise ValueError(f"it has more than {most_bytes:,} bytes")
        return parse(content)
    except (OSError, ValueError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise FileError(f"Expected {what} in {file}, got: {reason}. {advice}.") from error
