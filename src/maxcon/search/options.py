# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options whose values have names: the same words in Python, in a study and on the command line."""

from enum import StrEnum
from typing import ClassVar, Self

from maxcon.errors import OptionError

__all__ = ["Multiplicity", "NamedOption", "SearchMethod", "Weighting"]


class NamedOption(StrEnum):
    """Base of such options; a subclass says, as `option`, what its arguments are called, and lists its values."""

    option: ClassVar[str]

    def __init_subclass__(cls, *, option: str, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        cls.option = option

    @classmethod
    def parse(cls, value: str | Self) -> Self:
        """Return the value of that name; blanks and underscores in it stand for hyphens.

        Raises
        ------
        OptionError
            If there is none.
        """
        try:
            return cls(str(value).replace(" ", "-").replace("_", "-"))
        except ValueError:
            *others, last = (repr(member.value) for member in cls)
            names = f"{', '.join(others)} or {last}"
            raise OptionError(f"Expected `{cls.option}` to be {names}, got {value!r}.") from None


class Multiplicity(NamedOption, option="multiplicity"):
    """How much a match weighs (D4)."""

    OCCUPIED = "occupied"
    """One: free of density."""

    POINTS = "points"
    """As many as the map points in the voxel: the paper's count, biased by map density."""


class Weighting(NamedOption, option="weighting"):
    """The weight w of a match in N, equation (4); its count does not depend on it (D5).

    The direction of an observation is the map's normal; the scan's only weighs it. A map voxel without a normal
    constrains nothing, whatever the weight.
    """

    COSINE = "cosine"
    """max(0, n_scan . n_map); abs(n_scan . n_map) where the map's normals have no side. 1/2, its mean over all
    directions that the sensor can see, where the scan point has no normal."""

    PUBLISHED = "published"
    """The same, but 0 where the scan point has no normal: it counts, and constrains nothing."""

    ONE = "one"
    """1, whatever the normal of the scan point, and where it has none: what the other weights are compared with."""

    @property
    def without_normal(self) -> float:
        """Weight of a match whose scan point has no normal."""
        return _WEIGHTS_WITHOUT_NORMAL[self]


_WEIGHTS_WITHOUT_NORMAL = {Weighting.COSINE: 0.5, Weighting.PUBLISHED: 0.0, Weighting.ONE: 1.0}


class SearchMethod(NamedOption, option="search"):
    """How the best cell is found; it is the same one (D7)."""

    EXHAUSTIVE = "exhaustive"
    """Look at every cell. Only an answer in doubt is searched for farther around by bounds, coarse to fine."""

    BRANCH_AND_BOUND = "branch-and-bound"
    """Bound every cell, and look at those that could be the best."""
