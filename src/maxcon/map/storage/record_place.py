# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""RecordPlace: the file and the bytes in it where a record lies, and their checksum."""

from dataclasses import dataclass

__all__ = ["RecordPlace"]


@dataclass(frozen=True, slots=True)
class RecordPlace:
    """Where a record lies.

    Parameters
    ----------
    name : str
        Name of the file in the map.
    offset, length : int
        First byte, and number of bytes.
    sha256 : bytes
        Checksum of these bytes.
    """

    name: str
    offset: int
    length: int
    sha256: bytes
