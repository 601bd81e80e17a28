# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Lost: where a scan was taken in a whole map, without a prior."""

from maxcon.relocalization.relocalizer import Relocalization, Relocalizer

__all__ = ["Relocalization", "Relocalizer"]
