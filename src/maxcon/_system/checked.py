# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Values of TOML and JSON files, checked against a msgspec type in one place, with our errors."""

from typing import TypeVar

from maxcon.errors import FileError, MaxconError

__all__ = ["checked"]

T = TypeVar("T")


def checked(
    values: object, kind: type[T], where: object, what: str, advice: str, error: type[MaxconError] = FileError
) -> T:
    """Return values read from TOML or JSON as an instance of `kind`, a `msgspec.Struct` or another type msgspec knows.

    Bounds stand in the type: ``Annotated[float, msgspec.Meta(gt=0)]``. NaN and infinities pass such bounds in one
    direction; give both where they matter.

    Parameters
    ----------
    values : object
        As tomllib or json returned them.
    kind : type
        What they should be.
    where : object
        The file, for messages.
    what, advice : str
        For messages: what was expected there, and what to do.
    error : type
        Kind of the error raised.
    """
    import msgspec

    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as problem:
        said, _, place = str(problem).partition(" - at `$")
        at = f" at `{place.strip('.`')}`" if place.strip(".`") else ""
        said = said[0].lower() + said[1:]
        raise error(f"Expected {what} in {where}, got another{at}: {said}. {advice}.") from problem
