# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a map is known, and from what (decision 19)."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from maxcon.errors import FileError
from maxcon.mapping.build.pass_differences import compare_passes
from maxcon.mapping.build.place_sample import PlaceSample
from maxcon.map.layout import UNKNOWN_SIGMA
from maxcon._system.regular_file import read_regular

__all__ = ["aligned_sigma", "map_sigma"]

ALIGNMENT = "alignment.json"
LARGEST_ALIGNMENT = 2**24
LEAST_TIES = 50


def map_sigma(
    given: float | None, sample: PlaceSample, aligned: float | None = None
) -> tuple[float, dict[str, object]]:
    """Return how well a map is known, and what its manifest says of where that is from.

    Parameters
    ----------
    given : float or None
        Standard deviation of the map's position along any axis, m: it stands.
    sample : PlaceSample
        Points with times, from which it is estimated where it is not given.
    aligned : float, optional
        What `maxcon map align` says of a map of the clouds, m: their rounds agree better than they are right, so that
        what is estimated is not below it.

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
    if aligned is not None and (not found.is_enough or found.sigma_of_map <= aligned):
        return round(aligned, 4), {"from": "alignment"}
    if not found.is_enough:
        return UNKNOWN_SIGMA, {"from": "assumed", "reason": found.shortcoming}
    return round(found.sigma_of_map, 4), {
        "from": "passes",
        "n_passes": found.n_passes,
        "sigma_of_pass": round(found.sigma_of_pass, 4),
        "n_places": found.n_places,
    }


def aligned_sigma(files: Sequence[Path]) -> float | None:
    """What `maxcon map align` wrote beside all of these clouds of a map made of them, m; None where it did not.

    Raises
    ------
    FileError
        If an alignment.json beside them cannot be read, or does not say it.
    """
    folders = {file.parent for file in files}
    if not all((folder / ALIGNMENT).exists() for folder in folders):
        return None
    return max(_sigma_said(folder / ALIGNMENT) for folder in folders)


def _sigma_said(file: Path) -> float:
    try:
        said = json.loads(read_regular(file, LARGEST_ALIGNMENT))
        sigma, n_ties, n_rounds = float(said["sigma"]["of_map"]), int(said["n_ties"]), int(said["n_rounds"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileError(
            f"Expected {file} to be what `maxcon map align` writes, got: {str(error)[:80]!r}. Give --sigma, or move"
            " the clouds elsewhere."
        ) from None
    if not 0.0 <= sigma < math.inf:
        raise FileError(f"Expected a sigma of the map of 0 m or more in {file}, got {sigma}. Give --sigma.")
    # A few ties, or one round with itself, say nothing of what all rounds together are wrong by.
    return sigma if n_rounds > 1 and n_ties >= LEAST_TIES else max(sigma, UNKNOWN_SIGMA)
