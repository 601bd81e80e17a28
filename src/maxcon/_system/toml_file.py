# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""TOML files, read within bounds of size and of depth."""

import re
import tomllib
from pathlib import Path
from typing import Any

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError

__all__ = ["read_toml"]

LARGEST = 2**20
"""Bytes; such a file is a page of text."""
DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){31}""")
"""Keys of as many parts take memory that grows with the square of their length, before anyone looks at them."""


def read_toml(file: Path, what: str, advice: str) -> dict[str, Any]:
    """Return what a TOML file says.

    Parameters
    ----------
    file : Path
        The file.
    what, advice : str
        For messages: what it should be, and what to do.

    Raises
    ------
    FileError
        If it cannot be read, is too large, or is no TOML.
    """
    try:
        with open_regular(file) as stream:
            content = stream.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise ValueError(f"it has more than {LARGEST:,} bytes")
        text = content.decode("utf-8")
        if DEEP_KEY.search(text):
            raise ValueError("a key of 32 parts or more")
        return tomllib.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise FileError(f"Expected {what} in {file}, got: {reason}. {advice}.") from error
