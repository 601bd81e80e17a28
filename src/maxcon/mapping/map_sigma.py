# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a map is known, and from what (decision 19)."""

from maxcon.mapping.pass_differences import compare_passes
from maxcon.mapping.place_sample import PlaceSample
from maxcon.point_map.sigma import UNKNOWN_SIGMA

__all__ = ["map_sigma"]


def map_sigma(given: float | None, sample: PlaceSample) -> tuple[float, dict[str, object]]:
    """Return how well a map is known, and what its manifest says of where that is from.

    Parameters
    ----------
    given : float or None
        Standard deviation of the map's position along any axis, m: it stands.
    sample : PlaceSample
        Points with times, from which it is estimated where it is not given.

    Returns
    -------
    sigma : float
        m; estimates are rounded to 0.1 mm, and where there are not enough passes it is `UNKNOWN_SIGMA`.
    build : dict
        The entry `sigma` of the manifest's `build` (docs/map_format.md).
    """
    if given is not None:
        return float(given), {"from": "given"}
    found = compare_passes(sample.records())
    if not found.is_enough:
        return UNKNOWN_SIGMA, {"from": "assumed", "reason": found.shortcoming}
    return round(found.sigma_of_map, 4), {
        "from": "passes",
        "n_passes": found.n_passes,
        "sigma_of_pass": round(found.sigma_of_pass, 4),
        "n_places": found.n_places,
    }
