# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long jobs tell how far they are."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with (step, done, of how many)."""
