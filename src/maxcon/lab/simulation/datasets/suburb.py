# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A dataset from a suburb: hedges, gardens and few facades, on slopes, scanned from a moving car."""

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
)
from maxcon.lab.simulation.driving.gnss_priors import GnssErrors
from maxcon.lab.simulation.driving.prior_errors import PriorErrors
from maxcon.lab.simulation.scenes.las_classes import LasClass
from maxcon.lab.simulation.scenes.suburb_road import check_road_length
from maxcon.lab.simulation.sensing.moving_scanner import DeskewErrors, MovingScanner
from maxcon.lab.simulation.sensing.scanner_layouts import ScannerLayout
from maxcon.lab.simulation.sensing.scanners import ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.lab.simulation.worlds.suburb_world import ROAD_LENGTH, SuburbWorld, n_epochs_on

__all__ = ["simulate_suburb"]


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
