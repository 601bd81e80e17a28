# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Names of files: the suffixes of scans, and the order of files that are numbered."""

import re
from pathlib import Path

__all__ = ["NUMBER", "SCAN_SUFFIXES", "in_natural_order"]

SCAN_SUFFIXES = (".bin", ".pcd", ".las", ".laz", ".ply", ".npz")
NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")


def in_natural_order(paths: list[Path]) -> list[Path]:
    """Sort by name, numbers by value: 2 before 10, and 1.25 before 1.5 where all names are numbers."""
    if all(NUMBER.fullmatch(path.stem) for path in paths):
        return sorted(paths, key=lambda path: (float(path.stem), path.name))

    def key(path: Path) -> tuple[list[str | int], str]:
        parts = re.split(r"([0-9]+)", path.name)
        return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.name

    return sorted(paths, key=key)
