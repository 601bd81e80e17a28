# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Numbers of a study's page: rates, intervals, quantiles by method."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.evaluation import SUCCESS_WORDS
from maxcon.lab.evaluation.distinctness import GUARD_RADIUS
from maxcon.lab.paper.claims import COUNT, HELMERT
from maxcon.lab.paper.distinctness import Distinctnesses, plot_distinctness, plot_kurtosis_map
from maxcon.lab.report.errors import plot_error_distributions, plot_success
from maxcon.lab.report.pages import Picture
from maxcon.lab.study import MethodRows, known_methods
from maxcon.map import PointMap
from maxcon.search.space import SearchSpace

# Methods that are drawn together in one picture, the first `MOST_SHOWN` of those that a study has.
SHOWN = (
    "maxcon", "helmert-points", "helmert-occupied", "count-points", "count-occupied",
    "icp-plane-1m", "icp-plane-3m", "gicp-3m", "icp-point-3m",
)  # fmt: skip
MOST_SHOWN = 8
NAMES = {
    "maxcon": "maxcon, refined",
    "helmert-points": "Helmert, as published",
    "helmert-occupied": "Helmert, our defaults",
    "count-points": "Count, as published",
    "count-occupied": "Count, our defaults",
}
OCCUPIED = ("count-occupied", "helmert-occupied")


def draw_statistics(folder: Path, methods: Mapping[str, MethodRows], point_map: PointMap | None) -> list[Picture]:
    """Draw the figures into a folder, as SVG; return them with their captions.

    folder: where the figures go; must exist.
    methods: by name, one prior.
    point_map: drawn below the trajectory, if given.
    """
    pictures = []
    for pair, stem, words in (
        ((COUNT, HELMERT), "distinctness-points", "as published"),
        (OCCUPIED, "distinctness-occupied", "by our defaults"),
    ):
        if _have(methods, pair, "kurtosis"):
            pictures.append(_distinctness(folder / f"{stem}.svg", methods, pair, words))
    for pair, stem in (((COUNT, HELMERT), "kurtosis-points"), (OCCUPIED, "kurtosis-occupied")):
        if _have(methods, pair, "kurtosis", "reference_x"):
            pictures.append(_kurtosis(folder / f"{stem}.svg", methods, pair, point_map))
            break
    shown = shown_methods(methods)
    pictures += _success(folder / "success.svg", methods, shown)
    if len(common_epochs(methods, shown)):
        pictures.append(_error_distributions(folder / "errors.svg", methods, shown))
    return pictures


def own_methods(methods: Mapping[str, MethodRows]) -> list[str]:
    """Names of the methods that are the user's own."""
    known = known_methods(SearchSpace.paper())
    return [name for name in methods if name not in known]


def shown_methods(methods: Mapping[str, MethodRows]) -> list[str]:
    """Names of the methods that are drawn together in one picture, at most 8: the user's own first."""
    named = [*own_methods(methods), *(name for name in SHOWN if name in methods)]
    return (named or list(methods))[:MOST_SHOWN]


def _have(methods: Mapping[str, MethodRows], names: Sequence[str], *columns: str) -> bool:
    """Whether each of these methods has, in epochs common to all, some value in each of these columns."""
    if not all(name in methods for name in names):
        return False
    epochs = common_epochs(methods, names)
    return all(bool(np.isfinite(_column(methods[name], column, epochs)).any()) for name in names for column in columns)


def common_epochs(methods: Mapping[str, MethodRows], names: Sequence[str]) -> NDArray[np.float64]:
    """Numbers of the epochs that all of these methods have a row for, rising."""
    epochs = methods[names[0]].numbers("epoch")
    for name in names[1:]:
        epochs = np.intersect1d(epochs, methods[name].numbers("epoch"))
    return epochs


def _column(rows: MethodRows, name: str, epochs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of a column in the given epochs, in order of epochs."""
    return rows.numbers(name)[np.isin(rows.numbers("epoch"), epochs)]


def _distinctness(path: Path, methods: Mapping[str, MethodRows], pair: Sequence[str], words: str) -> Picture:
    epochs = common_epochs(methods, pair)
    fields = ("peak_ratio", "kurtosis", "divergence", "spread")
    plot_distinctness(
        path,
        {NAMES[name]: Distinctnesses(*(_column(methods[name], field, epochs) for field in fields)) for name in pair},
        title=f"How distinct the answers are: {words}",
    )
    return Picture(
        f"How distinct the answers are, {words}",
        f"The paper's comparisons over all epochs. Peak ratio: second highest over highest score, beyond"
        f" {GUARD_RADIUS:g} m and over all headings. Kurtosis and divergence from a Laplace distribution: of the"
        " scores along the line through the"
        " best cell in its least determined direction. Spread: the farthest cell that reaches 90 % of the best.",
        "Histograms of four measures of distinctness, count beside Helmert's score.",
        path,
    )


def _kurtosis(
    path: Path, methods: Mapping[str, MethodRows], pair: Sequence[str], point_map: PointMap | None
) -> Picture:
    epochs = common_epochs(methods, pair)
    rows = methods[pair[0]]
    positions = np.column_stack([_column(rows, f"reference_{axis}", epochs) for axis in ("x", "y", "z")])
    is_known = np.isfinite(positions).all(axis=1)
    local = positions[is_known]
    local = local - local.min(axis=0) if point_map is None else point_map.frame.to_local(local)
    plot_kurtosis_map(
        path,
        local,
        *(_column(methods[name], "kurtosis", epochs)[is_known] for name in pair),
        names=(NAMES[pair[0]], NAMES[pair[1]]),
        point_map=point_map,
        title="Kurtosis along the drive",
    )
    return Picture(
        "Kurtosis along the drive",
        f"Small circles: {NAMES[pair[0]]}. Large circles: {NAMES[pair[1]]}. Dark: the scores are flat along the"
        " least determined direction; bright: one distinct peak.",
        "The trajectory from above with circles coloured by kurtosis.",
        path,
    )


def _success(path: Path, methods: Mapping[str, MethodRows], shown: Sequence[str]) -> list[Picture]:
    offsets, successes = {}, {}
    for name in shown:
        distance = methods[name].numbers("prior_distance")
        is_known = np.isfinite(distance) & methods[name].is_tried
        if is_known.any():
            offsets[NAMES.get(name, name)] = distance[is_known]
            successes[NAMES.get(name, name)] = methods[name].numbers("is_success")[is_known] == 1.0
    if not offsets:
        return []
    plot_success(path, offsets, successes)
    return [
        Picture(
            "Success against the error of the prior",
            f"Epochs within {SUCCESS_WORDS} of the reference, by how far off the prior was; trusted or not. At most"
            " eight methods are drawn; the tables have all.",
            "Success rates over the distance of the prior, a line for each method.",
            path,
        )
    ]


def _error_distributions(path: Path, methods: Mapping[str, MethodRows], shown: Sequence[str]) -> Picture:
    epochs = common_epochs(methods, shown)
    plot_error_distributions(
        path, {NAMES.get(name, name): _column(methods[name], "distance", epochs) for name in shown}
    )
    return Picture(
        "How many epochs stay within which error",
        "Of all epochs, trusted or not; an epoch without an answer is within no error.",
        "Cumulative distributions of the horizontal error, a line for each method.",
        path,
    )
