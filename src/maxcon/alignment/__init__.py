# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rounds of a mapping campaign, brought together before a map is made of them."""

from maxcon.alignment.align import align_files
from maxcon.alignment.alignment import Alignment
from maxcon.alignment.options import AlignmentOptions

__all__ = ["Alignment", "AlignmentOptions", "align_files"]
