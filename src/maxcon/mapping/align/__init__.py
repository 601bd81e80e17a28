"""Alignment of the passes of a mapping campaign, before a map is made of them."""

from maxcon.mapping.align.align import AlignmentOptions, align_files
from maxcon.mapping.align.alignment import Alignment

__all__ = ["Alignment", "AlignmentOptions", "align_files"]
