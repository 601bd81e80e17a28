# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The paper's measurement campaign, simulated: a circuit mapped in five rounds, and 3001 scans of another day."""

import os
from collections.abc import Callable, Sequence

from maxcon.errors import OptionError
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation.datasets.dataset_files import (
    PRIORS,
    dataset_folder,
    ticker,
    write_description,
    write_epochs,
    write_map,
    write_odometry,
)
from maxcon.lab.simulation.driving.gnss_priors import GnssErrors
from maxcon.lab.simulation.driving.odometry import OdometryErrors
from maxcon.lab.simulation.driving.prior_errors import PriorErrors
from maxcon.lab.simulation.sensing.scanners import ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.lab.simulation.worlds.campaign_world import MOST_EPOCHS, CampaignWorld
from maxcon.lab.simulation.worlds.scan_epochs import EPOCH_STEP

__all__ = ["simulate_campaign"]


def simulate_campaign(
    out: str | os.PathLike[str],
    *,
    n_epochs: int = MOST_EPOCHS,
    every: float | None = None,
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
        Folder to write; it appears only when all in it is complete.
    n_epochs : int
        How many scans. 3001 are 0.1 s apart and take the 300 s of the round; fewer are chosen from these,
        spread evenly over the same round.
    every : float, optional
        Seconds between two scans, a multiple of 0.1, from the beginning of the round on: for tracking.
        Without it the scans are spread evenly.
    seed : int
        The same seed gives the same city, drives, scans, priors and map points.
    is_hard : bool
        Whether the facades repeat every 3 m, a quarter of the objects that break their period has been removed
        since the mapping, and 30 % of the returns are on objects that are not in the map.
    n_rounds : int
        How often the circuit is mapped.
    mapping_scanners : sequence of ProfileScanner, optional
        On the mapping vehicle; two turned by 45 degrees to either side if None.
    scanner : RotatingScanner, optional
        On the car; a VLP-16 if None.
    overwrite : bool
        Whether a dataset at `out` is replaced; anything else there is an error.
    progress : callable, optional
        Called with (done, total) after each step.

    Returns
    -------
    Dataset
        The paths of its parts. Its priors are `gnss` (slowly changing errors of about 1.2 m, see `GnssErrors`)
        and `uniform` (independent errors of up to 2.5 m, see `PriorErrors`). Its odometry is of the whole round, ten
        poses a second, and drifts (see `OdometryErrors`).

    Raises
    ------
    OptionError
        If `n_epochs` is not 1 to 3001, or so many scans `every` seconds apart take longer than the round, or if
        `n_rounds` is below 1 or `seed` negative.
    MissingExtraError
        If embreex is not installed.
    FileError
        If `out` exists and `overwrite` is False, or cannot be written.

    Notes
    -----
    Map and scans are streamed to disk and never in memory as a whole.
    """
    if not 1 <= n_epochs <= MOST_EPOCHS:
        raise OptionError(
            f"Expected 1 to {MOST_EPOCHS} epochs of a campaign, got n_epochs = {n_epochs}."
            " A round has no more: the scanner turns ten times a second for 300 s. Take another seed for more."
        )
    ticks_apart = None if every is None else _ticks_apart(every, n_epochs)
    with dataset_folder(out, overwrite=overwrite) as folder:
        world = CampaignWorld.build(seed, n_rounds, is_hard=is_hard)
        profiles = mapping_scanners or mobile_mapping_scanners()
        tick = ticker(progress, world.mapping.n_pieces(profiles) + n_epochs)
        kind = "hard campaign" if is_hard else "campaign"
        words = f"{kind}, seed {seed}, {n_rounds} rounds of mapping, {n_epochs} epochs"
        write_description(folder, words, PRIORS, has_odometry=True)
        write_map(folder, world.mapping, profiles, tick)
        write_odometry(folder, *world.odometry(OdometryErrors()))
        epochs = world.epochs(n_epochs, ticks_apart)
        rotating = scanner or RotatingScanner()
        priors = {
            "gnss": world.gnss_priors(epochs, GnssErrors()),
            "uniform": world.uniform_priors(epochs, PriorErrors()),
        }
        write_epochs(folder, epochs, (world.scan(epoch, rotating) for epoch in epochs), priors, tick)
    return Dataset.open(out)


def _ticks_apart(every: float, n_epochs: int) -> int:
    """How many tenths of a second lie between two scans."""
    ticks = round(every / EPOCH_STEP) if 0.0 < every < MOST_EPOCHS else 0
    if ticks < 1 or abs(ticks * EPOCH_STEP - every) > 1e-6 or ticks * (n_epochs - 1) >= MOST_EPOCHS:
        raise OptionError(
            f"Expected `every` to be a multiple of {EPOCH_STEP} s with which {n_epochs} epochs fit into the round of"
            f" {(MOST_EPOCHS - 1) * EPOCH_STEP:g} s, got {every} s. Take fewer epochs?"
        )
    return ticks
