# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Two folders change places in one step, where the system can: nothing that comes in between loses either."""

import ctypes
import os
import sys
from pathlib import Path

__all__ = ["swapped"]

AT_FDCWD = -100
RENAME_EXCHANGE = 2
"""Of `renameat2`, Linux."""
RENAME_SWAP = 2
"""Of `renamex_np`, macOS."""


def swapped(one: Path, other: Path) -> bool:
    """Exchange two existing files or folders of one file system; False where the system has no such step.

    Notes
    -----
    Python has no call for it. Where this is False nothing has changed.
    """
    first, second = os.fsencode(one), os.fsencode(other)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            return bool(library.renamex_np(first, second, ctypes.c_uint(RENAME_SWAP)) == 0)
        return bool(library.renameat2(AT_FDCWD, first, AT_FDCWD, second, ctypes.c_uint(RENAME_EXCHANGE)) == 0)
    except (AttributeError, OSError, TypeError):  # no such function, or no C library by that name
        return False
