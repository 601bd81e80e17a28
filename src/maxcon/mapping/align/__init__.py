# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rounds of a mapping campaign, brought together before a map is made of them."""

from maxcon.mapping.align.align import align_files
from maxcon.mapping.align.alignment import Alignment
from maxcon.mapping.align.options import AlignmentOptions

__all__ = ["Alignment", "AlignmentOptions", "align_files"]
