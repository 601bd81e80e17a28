# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rows of trajectories in text files: numbers, and what is said of a line that is no pose."""

from collections.abc import Callable
from pathlib import Path
from typing import NoReturn, ParamSpec

from maxcon.errors import TrajectoryError
from maxcon.io.text import parse_float

__all__ = ["Line", "Row", "numbers_of", "parsed", "refuse", "words_of_line"]

Line = tuple[int, str]
Row = tuple[int, list[float]]
P = ParamSpec("P")


def refuse(file: Path, number: int, words: str) -> NoReturn:
    """Refuse a file because of a line."""
    raise TrajectoryError(words_of_line(file, number, words)) from None


def words_of_line(file: Path, number: int, words: str) -> str:
    """Put the name of the file and the number of the line before what is said of it."""
    return f"{file}, line {number}: {words}"


def numbers_of(file: Path, number: int, texts: list[str], names: str) -> list[float]:
    """Return the finite numbers that stand in a line; `names` says what they should be."""
    values = [parse_float(text) for text in texts]
    if None in values:
        text = texts[values.index(None)][:40]
        refuse(file, number, f"Expected finite numbers for '{names}', got {text!r}. Correct or remove this line.")
    return [value for value in values if value is not None]


def parsed(
    left_out: list[str] | None, parse: Callable[P, list[float]], *args: P.args, **kwargs: P.kwargs
) -> list[float] | None:
    """Return the numbers of a row; None where it is none, which is told in `left_out` if that is given."""
    try:
        return parse(*args, **kwargs)
    except TrajectoryError as error:
        if left_out is None:
            raise
        left_out.append(str(error))
        return None
