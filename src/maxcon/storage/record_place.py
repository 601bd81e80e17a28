# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""RecordPlace: which bytes of which file a record is, and what they must be."""

from dataclasses import dataclass

__all__ = ["RecordPlace"]


@dataclass(frozen=True, slots=True)
class RecordPlace:
    """Where a record lies.

    Parameters
    ----------
    name : str
        Of the file in the map.
    offset, length : int
        Of its bytes.
    sha256 : bytes
        Of them.
    """

    name: str
    offset: int
    length: int
    sha256: bytes
