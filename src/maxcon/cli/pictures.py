# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which epochs `maxcon localize` draws, and how."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maxcon.drive.localize import EpochEstimate
    from maxcon.drive.within_sigmas import WithinSigmas
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap

__all__ = ["drawer", "parse_epochs"]

# Pictures drawn when none are asked for by number, evenly over the drive.
N_PICTURES = 10


def parse_epochs(text: str | None, n_epochs: int) -> frozenset[int]:
    """Epoch numbers of "0,5,10-20" or "all"; ten evenly over the drive for None.

    Raises
    ------
    OptionError
        If the text is not such a list or a number is not an epoch.
    """
    from maxcon.errors import OptionError

    if text is None:
        step = max(1, -(-n_epochs // N_PICTURES))
        return frozenset(range(0, n_epochs, step))
    if text.strip().lower() == "all":
        return frozenset(range(n_epochs))
    numbers: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        last = last if dash else first
        is_listed = all(n.isascii() and n.isdigit() and len(n) < 19 for n in (first, last))
        if not (is_listed and int(first) <= int(last) < n_epochs):
            raise OptionError(
                f"Expected --plot-epochs to list epochs from 0 to {n_epochs - 1}, such as 0,5,10-20, or all,"
                f" got {part.strip()[:40]!r}."
            )
        numbers.update(range(int(first), int(last) + 1))
    return frozenset(numbers)


def drawer(
    folder: Path, point_map: "PointMap", method: "MaximumConsensus | WithinSigmas", objective: str
) -> Callable[["EpochEstimate"], None]:
    """Return a function that draws an epoch into the folder."""
    from maxcon._system.atomic import make_folder
    from maxcon._system.partials import sweep_folder
    from maxcon.localizer import MaximumConsensus
    from maxcon.plotting.canvas.figure import check_matplotlib
    from maxcon.plotting.epoch import plot_epoch

    check_matplotlib()
    sweep_folder(folder)

    def draw(epoch: "EpochEstimate") -> None:
        if epoch.estimate is None or epoch.prior is None:
            return
        searching = method if isinstance(method, MaximumConsensus) else method.at(epoch.raw.time)
        make_folder(folder)
        plot_epoch(
            folder / f"{epoch.epoch:06d}.png",
            accumulator=searching.accumulate(epoch.scan, point_map, epoch.prior),
            objective=searching.cell_search.objective,
            estimate=epoch.estimate,
            scan=epoch.scan,
            point_map=point_map,
            title=f"Epoch {epoch.epoch} ({epoch.raw.name}), {objective}, {searching.multiplicity}",
        )

    return draw
