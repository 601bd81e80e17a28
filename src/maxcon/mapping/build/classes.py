# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which classes of points a map leaves out (the paper: ground, vegetation, vehicles)."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from maxcon.errors import OptionError

__all__ = [
    "CLASS_NAMES",
    "DEFAULT_DROP",
    "FOUND_DROP",
    "GROUND",
    "NOISE",
    "class_name",
    "found_shares",
    "parse_classes",
]

# ASPRS LAS 1.4 R15, table 17. There is no class for vehicles: 22 is for what changes between surveys,
# 64 and above are the user's own.
CLASS_NAMES: dict[str, tuple[int, ...]] = {
    "unclassified": (0, 1),
    "ground": (2, 11, 20),
    "low-vegetation": (3,),
    "medium-vegetation": (4,),
    "high-vegetation": (5,),
    "building": (6,),
    "noise": (7, 18),
    "water": (9,),
    "rail": (10,),
    "wire": (13, 14, 16),
    "tower": (15,),
    "bridge": (17,),
    "overhead": (19,),
    "snow": (21,),
    "temporal-exclusion": (22,),
}
GROUPS: dict[str, tuple[str, ...]] = {
    "vegetation": ("low-vegetation", "medium-vegetation", "high-vegetation")
}

DEFAULT_DROP = ("ground", "vegetation", "noise", "temporal-exclusion")
# Of classes that a build finds itself: what stands in hedges tells where one is, on real roads too (decision 23).
FOUND_DROP = ("ground", "temporal-exclusion")

# What vehicles drive on: its heights are kept, whether its points are dropped or not.
GROUND = frozenset(CLASS_NAMES["ground"] + CLASS_NAMES["bridge"])
UNCLASSIFIED = frozenset(CLASS_NAMES["unclassified"])
NOISE = frozenset(CLASS_NAMES["noise"])
LARGEST_CLASS = 255


def class_name(number: int) -> str:
    """Return the name of a class number, "class 64" for one without a name."""
    for name, numbers in CLASS_NAMES.items():
        if number in numbers:
            return name
    return f"class {number}"


def found_shares(n_points: Mapping[str, int], dropped: Collection[int]) -> list[tuple[str, float]]:
    """Shares of the points that were found to be ground, vegetation and temporary, and of those that are in the map.

    Parameters
    ----------
    n_points : mapping
        Points by class number, as text.
    dropped : collection of int
        The classes that are left out of the map.
    """
    numbers = {int(number): n for number, n in n_points.items()}
    total = max(1, sum(numbers.values()))
    groups = {
        "ground": CLASS_NAMES["ground"],
        "vegetation": tuple(number for name in GROUPS["vegetation"] for number in CLASS_NAMES[name]),
        "temporary": CLASS_NAMES["temporal-exclusion"],
    }
    shares = [
        (name, sum(numbers.get(number, 0) for number in members) / total) for name, members in groups.items()
    ]
    return [*shares, ("kept", sum(n for number, n in numbers.items() if number not in dropped) / total)]


def parse_classes(names: Sequence[str], vehicle_classes: Iterable[int] = ()) -> frozenset[int]:
    """Class numbers of names and numbers given as text.

    Parameters
    ----------
    names : sequence of str
        Names such as "ground" or "vegetation", or numbers from 0 to 255.
    vehicle_classes : iterable of int
        The numbers that "vehicle" stands for.

    Raises
    ------
    OptionError
        If a name is unknown or a number out of range.
    """
    vehicles = frozenset(_checked(number) for number in vehicle_classes)
    numbers: set[int] = set()
    for name in names:
        key = name.strip().lower().replace("_", "-")
        if key in GROUPS:
            numbers.update(*(CLASS_NAMES[member] for member in GROUPS[key]))
        elif key in CLASS_NAMES:
            numbers.update(CLASS_NAMES[key])
        elif key in ("vehicle", "vehicles") and vehicles:
            numbers.update(vehicles)
        elif key.isascii() and key.isdigit() and len(key) < 19:
            numbers.add(_checked(int(key)))
        else:
            known = ", ".join([*CLASS_NAMES, *GROUPS])
            raise OptionError(
                f"Expected a class number from 0 to {LARGEST_CLASS} or one of {known}, got {name!r}."
                " For vehicles, say which number they have: --vehicle-class 64."
            )
    return frozenset(numbers)


def _checked(number: int) -> int:
    if not 0 <= number <= LARGEST_CLASS:
        raise OptionError(f"Expected a class number from 0 to {LARGEST_CLASS}, got {number}. Correct it.")
    return number
