# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The paper's measurement campaign, simulated: a circuit mapped in five rounds, and 3001 scans of another day."""

import os
from collections.abc import Callable, Sequence

from maxcon.atomic import atomic_folder, check_replaceable
from maxcon.dataset import Dataset
from maxcon.errors import OptionError
from maxcon.simulation.campaign_world import MOST_EPOCHS, CampaignWorld
from maxcon.simulation.dataset_files import (
    DATASET_NAMES,
    PRIORS,
    ticker,
    write_description,
    write_epochs,
    write_map_clouds,
    write_trajectory,
)
from maxcon.simulation.drive import PriorErrors
from maxcon.simulation.gnss_priors import GnssErrors
from maxcon.simulation.scanners import ProfileScanner, RotatingScanner, mobile_mapping_scanners

__all__ = ["simulate_campaign"]


def simulate_campaign(
    out: str | os.PathLike[str],
    *,
    n_epochs: int = MOST_EPOCHS,
    seed: int = 0,
    is_hard: bool = False,
    n_rounds: int = 5,
    mapping_scanners: Sequence[ProfileScanner] | None = None,
    scanner: RotatingScanner | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Write a seeded campaign: a circuit through an inner city is mapped in rounds, and driven on another day.

    Parameters
    ----------
    out : path
        Folder to write; it appears only when everything in it is whole.
    n_epochs : int
        How many scans. 3001 are 0.1 s apart and take the 300 s of the round; fewer are some of these,
        spread evenly over the same round.
    seed : int
        The same seed gives the same city, drives, scans, priors and map points.
    is_hard : bool
        Whether the facades repeat every 3 m, a quarter of what breaks their period is gone since the
        mapping, and 30 % of the returns are on objects that are not in the map.
    n_rounds : int
        How often the circuit is mapped.
    mapping_scanners : sequence of ProfileScanner, optional
        On the mapping vehicle; two turned by 45 degrees to either side if None.
    scanner : RotatingScanner, optional
        On the car; a VLP-16 if None.
    overwrite : bool
        Whether a dataset that stands there is replaced; anything else there is an error.
    progress : callable, optional
        Called with (done, total) after each step.

    Returns
    -------
    Dataset
        Where its parts lie. Its priors are `gnss` (slowly changing errors of about 1.2 m, see `GnssErrors`)
        and `uniform` (independent errors of up to 2.5 m, see `PriorErrors`).

    Raises
    ------
    OptionError
        If `n_epochs` is not 1 to 3001, `n_rounds` is below 1 or `seed` is negative.
    MissingExtraError
        If embreex is not installed.
    FileError
        If `out` exists and `overwrite` is False, or cannot be written.

    Notes
    -----
    The map is streamed to disk and never stands in memory as a whole, and so are the scans.
    """
    if not 1 <= n_epochs <= MOST_EPOCHS:
        raise OptionError(
            f"Expected 1 to {MOST_EPOCHS} epochs of a campaign, got n_epochs = {n_epochs}."
            " A round has no more: the scanner turns ten times a second for 300 s. Take another seed for more."
        )
    if overwrite:
        check_replaceable(out, "a simulated dataset", DATASET_NAMES)
    with atomic_folder(out, overwrite=overwrite) as folder:
        world = CampaignWorld.build(seed, n_rounds, is_hard=is_hard)
        profiles = mapping_scanners or mobile_mapping_scanners()
        tick = ticker(progress, world.n_pieces(profiles) + n_epochs)
        kind = "hard campaign" if is_hard else "campaign"
        words = f"{kind}, seed {seed}, {n_rounds} rounds of mapping, {n_epochs} epochs"
        write_description(folder, words, PRIORS)
        write_map_clouds(folder, world.map_echoes(profiles), tick)
        write_trajectory(folder / "map/trajectory.txt", *world.map_poses(), "T_map_vehicle")
        epochs = world.epochs(n_epochs)
        rotating = scanner or RotatingScanner()
        priors = {
            "gnss": world.gnss_priors(epochs, GnssErrors()),
            "uniform": world.uniform_priors(epochs, PriorErrors()),
        }
        write_epochs(folder, epochs, (world.scan(epoch, rotating) for epoch in epochs), priors, tick)
    return Dataset.open(out)
