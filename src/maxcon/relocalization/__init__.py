# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Relocalization: where in a whole map a scan was taken, without a prior (decision 29)."""

from maxcon.relocalization.relocalizer import Relocalization, Relocalizer

__all__ = ["Relocalization", "Relocalizer"]
