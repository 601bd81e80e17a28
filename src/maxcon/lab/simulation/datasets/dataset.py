# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A simulated dataset on disk: map cloud, scans, reference and prior, in the file formats of real datasets."""

import os
from collections.abc import Callable, Sequence

import numpy as np

from maxcon.errors import OptionError
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation.datasets.dataset_files import (
    dataset_folder,
    ticker,
    write_description,
    write_map,
    write_scans,
    write_trajectory,
)
from maxcon.lab.simulation.driving.prior_errors import PriorErrors
from maxcon.lab.simulation.sensing.scanners import ProfileScanner, RotatingScanner, mobile_mapping_scanners
from maxcon.lab.simulation.worlds.world import SimulatedWorld

__all__ = ["simulate"]


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
