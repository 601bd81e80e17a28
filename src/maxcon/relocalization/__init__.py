"""Relocalization: where in a whole map a scan was taken, without a prior."""

from maxcon.relocalization.relocalizer import Relocalization, Relocalizer

__all__ = ["Relocalization", "Relocalizer"]
