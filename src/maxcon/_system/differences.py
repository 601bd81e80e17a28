# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What differs between two descriptions, in words: of what was begun, and of what shall go on with it."""

from typing import Any

__all__ = ["differences"]


def differences(before: Any, now: Any, where: str = "") -> str:
    """Say what differs between two descriptions, values by names: "space.half_width 3.0, got 3.6"."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return f"{where or 'it'} {before}, got {now}"
    keys = [key for key in {**before, **now} if before.get(key) != now.get(key)]
    return "; ".join(differences(before.get(key), now.get(key), f"{where}.{key}".strip(".")) for key in keys)
