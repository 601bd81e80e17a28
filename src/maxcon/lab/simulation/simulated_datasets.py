# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Simulated datasets: the small city, the campaign, the suburb."""

import os
from collections.abc import Callable, Sequence

import numpy as np

from maxcon.errors import OptionError
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation.campaign_world import MOST_EPOCHS, CampaignWorld
from maxcon.lab.simulation.dataset_files import (
    PRIORS,
    dataset_folder,
    ticker,
    write_description,
    write_epochs,
    write_map,
    write_odometry,
    write_scans,
    write_trajectory,
)
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.measured_poses import GnssErrors, OdometryErrors, PriorErrors
from maxcon.lab.simulation.scanners import (
    DeskewErrors,
    MovingScanner,
    ProfileScanner,
    RotatingScanner,
    ScannerLayout,
    mobile_mapping_scanners,
)
from maxcon.lab.simulation.suburb_ground import check_road_length
from maxcon.lab.simulation.suburb_world import ROAD_LENGTH, SuburbWorld, n_epochs_on
from maxcon.lab.simulation.world import EPOCH_STEP, SimulatedWorld


def simulate(
    out: str | os.PathLike[str],
    *,
    n_epochs: int = 40,
    seed: int = 0,
    before: float = 75.0,
    after: float = 50.0,
    mapping_wait: float = 0.0,
    mapping_scanners: Sequence[ProfileScanner] | None = None,
    scanner: RotatingScanner | None = None,
    prior_errors: PriorErrors | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Write a seeded dataset: a city is mapped, and driven through on another day.

    Parameters
    ----------
    out : path
        Folder to write; it appears only when all in it is complete.
    n_epochs : int
        How many scans, evenly spaced in time.
    seed : int
        The same seed gives the same city, drives, scans, priors and map points.
    before, after : float
        How far from the middle of the crossing the scans begin and end, m.
    mapping_wait : float
        How long the mapping vehicle stands before the crossing, s: there the map is far denser than elsewhere.
    mapping_scanners : sequence of ProfileScanner, optional
        On the mapping vehicle; two turned by 45 degrees to either side if None.
    scanner : RotatingScanner, optional
        On the car; a VLP-16 if None.
    prior_errors : PriorErrors, optional
        How far the priors are off; up to 2.5 m and 1.8 degrees if None.
    overwrite : bool
        Whether a dataset at `out` is replaced; anything else there is an error.
    progress : callable, optional
        Called with (done, total) after each step.

    Returns
    -------
    Dataset
        The paths of its parts.

    Raises
    ------
    OptionError
        If `n_epochs` is below 1, `seed` or `mapping_wait` is negative or the route is too short.
    MissingExtraError
        If embreex is not installed.
    FileError
        If `out` exists and `overwrite` is False, or cannot be written.

    Notes
    -----
    The default has some 4 million map points within 60 m of the mapping vehicle and 27,000 points per scan.
    """
    if n_epochs < 1:
        raise OptionError(f"Expected at least one epoch, got n_epochs = {n_epochs}. The default is 40.")
    with dataset_folder(out, overwrite=overwrite) as folder:
        world = SimulatedWorld.build(seed, before, after, mapping_wait)
        epochs = world.epochs(n_epochs, prior_errors or PriorErrors())
        profiles = mapping_scanners or mobile_mapping_scanners()
        tick = ticker(progress, world.mapping.n_pieces(profiles) + n_epochs)
        # The mapping vehicle's poses are written without errors: the map has no errors but the noise of its points.
        write_description(folder, f"seed {seed}, {n_epochs} epochs", {"uniform": "prior.txt"}, map_sigma=0.0)
        write_map(folder, world.mapping, profiles, tick)
        times = np.array([epoch.time for epoch in epochs])
        rotating = scanner or RotatingScanner()
        scans = (world.scan(epoch, rotating) for epoch in epochs)
        write_scans(folder, times, [epoch.reference for epoch in epochs], scans, tick)
        write_trajectory(folder / "prior.txt", times, [epoch.prior for epoch in epochs], "T_map_sensor, prior")
    return Dataset.open(out)


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


def simulate_suburb(
    out: str | os.PathLike[str],
    *,
    n_epochs: int = 200,
    seed: int = 0,
    road_length: float = ROAD_LENGTH,
    mapping_scanners: Sequence[ProfileScanner] | None = None,
    scanner: RotatingScanner | None = None,
    deskew_errors: DeskewErrors | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Write a seeded suburb: a residential road is mapped there and back, and driven on another day.

    Parameters
    ----------
    out : path
        Folder to write; it appears only when all in it is complete.
    n_epochs : int
        How many scans. 601 are 0.1 s apart and take the minute of the drive; fewer are chosen from these,
        spread evenly over the same drive.
    seed : int
        The same seed gives the same suburb, drives, scans, priors and map points.
    road_length : float
        60 to 2000 m.
    mapping_scanners : sequence of ProfileScanner, optional
        On the mapping vehicle; two turned by 45 degrees to either side if None.
    scanner : RotatingScanner, optional
        On the car; a VLP-16 if None. `ScannerLayout` has others.
    deskew_errors : DeskewErrors, optional
        Errors of the motion that scans are deskewed by; their defaults if None.
    overwrite : bool
        Whether a dataset at `out` is replaced; anything else there is an error.
    progress : callable, optional
        Called with (done, total) after each step.

    Returns
    -------
    Dataset
        The paths of its parts. Its priors are `gnss` and `uniform`, as those of `simulate_campaign`.

    Raises
    ------
    OptionError
        If the road has fewer than `n_epochs` epochs, is too short or too long, or `seed` is negative.
    MissingExtraError
        If embreex is not installed.
    FileError
        If `out` exists and `overwrite` is False, or cannot be written.

    Notes
    -----
    Map and scans are streamed to disk and never in memory as a whole.
    """
    check_road_length(road_length)
    if not 1 <= n_epochs <= n_epochs_on(road_length):
        raise OptionError(
            f"Expected 1 to {n_epochs_on(road_length)} epochs of a suburb, got n_epochs = {n_epochs}."
            " The drive has no more: the scanner turns ten times a second. Take a longer road for more."
        )
    with dataset_folder(out, overwrite=overwrite) as folder:
        world = SuburbWorld.build(seed, road_length)
        profiles = mapping_scanners or mobile_mapping_scanners()
        tick = ticker(progress, world.mapping.n_pieces(profiles) + n_epochs)
        write_description(folder, f"suburb, seed {seed}, {n_epochs} epochs", PRIORS, LasClass)
        write_map(folder, world.mapping, profiles, tick)
        epochs = world.epochs(n_epochs)
        moving = MovingScanner(scanner or ScannerLayout.VLP_16.scanner(), deskew_errors or DeskewErrors())
        priors = {
            "gnss": world.gnss_priors(epochs, GnssErrors()),
            "uniform": world.uniform_priors(epochs, PriorErrors()),
        }
        write_epochs(folder, epochs, (world.scan(epoch, moving) for epoch in epochs), priors, tick)
    return Dataset.open(out)
