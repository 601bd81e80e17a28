# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Classes of points by name and number (ASPRS LAS 1.4 R15, table 17), and which of them a map leaves out."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from maxcon.errors import OptionError

# There is no class for vehicles: 22 is for what changes between surveys, 64 and above are the user's own.
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
    "vegetation": (3, 4, 5),
}
DEFAULT_DROP = ("ground", "vegetation", "noise", "temporal-exclusion")
# Of classes that a build finds itself: hedges stay, as they help to localize on real roads.
FOUND_DROP = ("ground", "temporal-exclusion")

# Vehicles drive on it: its heights are kept, whether its points are dropped or not.
GROUND = frozenset(CLASS_NAMES["ground"] + CLASS_NAMES["bridge"])
UNCLASSIFIED = frozenset(CLASS_NAMES["unclassified"])
NOISE = frozenset(CLASS_NAMES["noise"])
FOUND = frozenset({2, 3, 4, 5, 22})
"""Classes that a build can find itself."""
LARGEST_CLASS = 255


def class_name(number: int) -> str:
    """Return the name of a class number, "class 64" for one without a name."""
    return next((name for name, numbers in CLASS_NAMES.items() if number in numbers), f"class {number}")


def found_ratios(n_points: Mapping[str, int], dropped: Collection[int]) -> list[tuple[str, float]]:
    """Ratios of the points found to be ground, vegetation and temporary, and of those kept in the map.

    `n_points`: points by class number, as text; `dropped`: the classes that are left out of the map.
    """
    numbers = {int(number): n for number, n in n_points.items()}
    total = max(1, sum(numbers.values()))
    groups = {"ground": "ground", "vegetation": "vegetation", "temporary": "temporal-exclusion"}
    ratios = [(group, sum(numbers.get(n, 0) for n in CLASS_NAMES[name]) / total) for group, name in groups.items()]
    return [*ratios, ("kept", sum(n for number, n in numbers.items() if number not in dropped) / total)]


def parse_classes(names: Sequence[str], vehicle_classes: Iterable[int] = ()) -> frozenset[int]:
    """Class numbers of names such as "vegetation" and numbers given as text; OptionError if unknown.

    `names`: names of classes, or numbers from 0 to 255; `vehicle_classes`: the numbers that "vehicle" stands for.
    """
    vehicles = frozenset(_in_range(number) for number in vehicle_classes)
    numbers: set[int] = set()
    for name in names:
        key = name.strip().lower().replace("_", "-")
        if key in CLASS_NAMES:
            numbers.update(CLASS_NAMES[key])
        elif key in ("vehicle", "vehicles") and vehicles:
            numbers.update(vehicles)
        elif key.isascii() and key.isdigit() and len(key) < 19:
            numbers.add(_in_range(int(key)))
        else:
            raise OptionError(
                f"Expected a class number from 0 to {LARGEST_CLASS} or one of {', '.join(CLASS_NAMES)}, got {name!r}."
                " For vehicles, say which number they have: --vehicle-class 64."
            )
    return frozenset(numbers)


def _in_range(number: int) -> int:
    if not 0 <= number <= LARGEST_CLASS:
        raise OptionError(f"Expected a class number from 0 to {LARGEST_CLASS}, got {number}. Correct it.")
    return number
