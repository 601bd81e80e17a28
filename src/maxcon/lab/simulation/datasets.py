"""Simulated datasets: the small city, the campaign, the suburb, written in the formats of real data."""

import itertools
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.version import __version__
from maxcon.errors import OptionError
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.trajectories import write_tum
from maxcon.lab.dataset import DESCRIPTION, Dataset
from maxcon.lab.simulation.drive import Carrier, OdometryErrors, PriorErrors
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.scanners import MAPPING_SCANNERS, ProfileScanner, Returns, RotatingScanner, Scanner
from maxcon.lab.simulation.worlds import (
    EPOCH_STEP,
    MOST_EPOCHS,
    ROAD_LENGTH,
    CampaignWorld,
    Epoch,
    SimulatedWorld,
    SuburbWorld,
    World,
    n_epochs_on,
)
from maxcon.scan.trajectory import Trajectory

CRS = "EPSG:25832"
CITY_ORIGIN = (550_000.0, 5_802_000.0, 60.0)  # global coordinates (ETRS89 / UTM 32N, m) of the middle of the crossing
TILE_EDGE = 50.0
RESOLUTION = 0.001  # of the stored coordinates, m
ODOMETRY = "odometry.txt"
DATASET_NAMES = (
    DESCRIPTION, "map", "scans", "reference.txt", "prior.txt", "prior_*.txt", ODOMETRY, "drive.bag", "drive.mcap",
)  # fmt: skip
"""All that the folder of a simulated dataset may hold; what holds anything else is not overwritten."""


DESCRIBED = f"""# A dataset simulated by maxcon {{words}}.
# Classes of the map: {{classes}}.

[map]
clouds = "map/tile_*.laz"
trajectory = "map/trajectory.txt"
crs = "{CRS}"
vehicle_classes = [{LasClass.VEHICLE.value}]
{{sigma}}
[scans]
folder = "scans"
times = "scans/times.txt"
reference = "reference.txt"
{{odometry}}{{changed}}
[priors]
{{priors}}
"""


class DatasetOptions(TypedDict, total=False):
    """Options of every simulated dataset."""

    seed: int  # the same seed gives the same scene, drives, scans, priors and map points; 0 by default
    # On the mapping vehicle; two turned by 45 degrees to either side by default
    mapping_scanners: Sequence[ProfileScanner]
    scanner: Scanner  # on the car; a VLP-16 by default. `ScannerLayout` has others.
    overwrite: bool  # whether a dataset at `out` is replaced; anything else there is an error
    progress: Callable[[int, int], None]  # called with (done, total) after each step


def simulate(
    out: str | os.PathLike[str], *, n_epochs: int = 40, before: float = 75.0, after: float = 50.0,
    mapping_wait: float = 0.0, prior_errors: PriorErrors | None = None, carrier: Carrier = Carrier.CAR,
    changed: float = 0.0,
    **options: Unpack[DatasetOptions],
) -> Dataset:  # fmt: skip
    """Write a seeded dataset: a city is mapped, and driven through on another day.

    out: folder to write; it appears only when all in it is complete.
    n_epochs: how many scans, evenly spaced in time.
    before, after: how far from the middle of the crossing the scans begin and end, m.
    mapping_wait: how long the mapping vehicle stands before the crossing, s: there the map is far denser.
    prior_errors: how far the priors are off; up to 2.5 m and 1.8 degrees if None.
    carrier: of the scanner. From the hand, priors are level: they know neither roll nor pitch.
    changed: which part of houses, trees, kerbs and roads months have changed between map and scans, 0 to 1: see
        `Months`. The ratio of the returns that it changes is measured and written into the description.

    The default has some 4 million map points within 60 m of the mapping vehicle and 27,000 points per scan. An
    OptionError if `n_epochs` is below 1, the seed or `mapping_wait` is negative or the route is too short; a
    MissingExtraError without embreex; a FileError if `out` exists and `overwrite` is False, or cannot be written.
    """
    if n_epochs < 1:
        raise OptionError(f"Expected at least one epoch, got n_epochs = {n_epochs}. The default is 40.")
    seed = options.get("seed", 0)
    with _dataset_folder(out, options) as folder:
        world = SimulatedWorld.build(seed, before, after, mapping_wait, carrier, changed)
        epochs = world.epochs(n_epochs)
        priors = {"uniform": world.uniform_priors(epochs, prior_errors)}
        if carrier is Carrier.HAND:
            priors = {"level": [replace(prior, roll=0.0, pitch=0.0) for prior in priors["uniform"]]}
        # The mapping vehicle's poses are written without errors: the map has no errors but the noise of its points.
        _write(folder, world, epochs, priors, options, f"seed {seed}, {n_epochs} epochs", map_sigma=0.0)
    return Dataset.open(out)


def simulate_campaign(
    out: str | os.PathLike[str], *, n_epochs: int = MOST_EPOCHS, every: float | None = None, is_hard: bool = False,
    n_rounds: int = 5, changed: float = 0.0, **options: Unpack[DatasetOptions],
) -> Dataset:  # fmt: skip
    """Write a seeded campaign: a circuit through an inner city is mapped in rounds, and driven on another day.

    n_epochs: how many scans. 3001 are 0.1 s apart and take the 300 s of the round; fewer are chosen from these, spread
        evenly over the same round.
    every: seconds between two scans, a multiple of 0.1, from the beginning of the round on: for tracking.
    is_hard: whether the facades repeat every 3 m, a quarter of the objects that break their period has been removed
        since the mapping, and 30 % of the returns are on objects that are not in the map.
    n_rounds: how often the circuit is mapped.
    changed: as of `simulate`; 0 where `is_hard`.

    The priors are `gnss` (slowly changing errors of about 1.2 m, see `draw_gnss_errors`) and `uniform` (independent
    errors of up to 2.5 m, see `PriorErrors`). Odometry is of the whole round, ten poses a second, and drifts (see
    `OdometryErrors`). An OptionError if `n_epochs` is not 1 to 3001, or so many scans `every` seconds apart take longer
    than the round, or if `n_rounds` is below 1; other errors as of `simulate`.
    """
    if not 1 <= n_epochs <= MOST_EPOCHS:
        raise OptionError(
            f"Expected 1 to {MOST_EPOCHS} epochs of a campaign, got n_epochs = {n_epochs}."
            " A round has no more: the scanner turns ten times a second for 300 s. Take another seed for more."
        )
    ticks_apart = None if every is None else _ticks_apart(every, n_epochs)
    seed = options.get("seed", 0)
    with _dataset_folder(out, options) as folder:
        world = CampaignWorld.build(seed, n_rounds, is_hard=is_hard, changed=changed)
        epochs = world.epochs(n_epochs, ticks_apart)
        kind = "hard campaign" if is_hard else "campaign"
        words = f"{kind}, seed {seed}, {n_rounds} rounds of mapping, {n_epochs} epochs"
        odometry = Trajectory.from_poses(*world.odometry(OdometryErrors()))  # its frame is not georeferenced
        write_tum(folder / ODOMETRY, odometry, "T_odometry_sensor, seconds of the week")
        _write(folder, world, epochs, _two_priors(world, epochs), options, words)
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
    out: str | os.PathLike[str], *, n_epochs: int = 200, road_length: float = ROAD_LENGTH,
    **options: Unpack[DatasetOptions],
) -> Dataset:  # fmt: skip
    """Write a seeded suburb: a residential road is mapped there and back, and driven on another day.

    n_epochs: how many scans. 601 are 0.1 s apart; fewer are chosen from these, spread evenly over the same minute.
    road_length: 60 to 2000 m.

    Priors as of `simulate_campaign`, errors as of `simulate`; an OptionError too if the road has fewer epochs.
    """
    if not 1 <= n_epochs <= n_epochs_on(road_length):
        raise OptionError(
            f"Expected 1 to {n_epochs_on(road_length)} epochs of a suburb, got n_epochs = {n_epochs}."
            " The drive has no more: the scanner turns ten times a second. Take a longer road for more."
        )
    seed = options.get("seed", 0)
    with _dataset_folder(out, options) as folder:
        world = SuburbWorld.build(seed, road_length)
        epochs = world.epochs(n_epochs)
        words = f"suburb, seed {seed}, {n_epochs} epochs"
        _write(folder, world, epochs, _two_priors(world, epochs), options, words, classes=LasClass)
    return Dataset.open(out)


def _two_priors(world: World, epochs: Sequence[Epoch]) -> dict[str, list[Pose]]:
    return {"gnss": world.gnss_priors(epochs), "uniform": world.uniform_priors(epochs)}


def _dataset_folder(out: str | os.PathLike[str], options: DatasetOptions) -> AbstractContextManager[Path]:
    """An empty folder to write a dataset to; it becomes `out` when the block ends well and vanishes otherwise."""
    overwrite = options.get("overwrite", False)
    if overwrite:
        check_replaceable(out, "a simulated dataset", DATASET_NAMES)
    return atomic_folder(out, overwrite=overwrite)


def _write(
    folder: Path, world: World, epochs: Sequence[Epoch], priors: Mapping[str, Sequence[Pose]], options: DatasetOptions,
    words: str, *, classes: Iterable[LasClass] = tuple(LasClass)[1:], map_sigma: float | None = None,
) -> None:  # fmt: skip
    """Measure map and scans, and write them, streamed, with poses and description; `words` begin its comment."""
    # `classes`: those that points of the map have; without `map_sigma` (m) its position is estimated from its rounds.
    import pyproj

    pieces = world.mapping.pieces(options.get("mapping_scanners", MAPPING_SCANNERS))
    n_steps, done, progress = len(pieces) + len(epochs), itertools.count(1), options.get("progress")

    def tick() -> None:
        if progress is not None:
            progress(next(done), n_steps)

    scanner = options.get("scanner", RotatingScanner())
    files = {name: "prior.txt" if len(priors) == 1 else f"prior_{name}.txt" for name in priors}
    text = DESCRIBED.format(
        words=f"{__version__}: {words}",
        classes=", ".join(f"{member.name.lower()} {member.value}" for member in classes),
        sigma="" if map_sigma is None else f"sigma = {map_sigma}\n",
        odometry=f'odometry = "{ODOMETRY}"\n' if (folder / ODOMETRY).exists() else "",
        changed=_changed(world, epochs, scanner) if world.changes else "",
        priors="\n".join(f'{name} = "{file}"' for name, file in files.items()),
    )
    (folder / DESCRIPTION).write_text(text, encoding="utf-8", newline="\n")
    (folder / "map").mkdir()
    frame = LocalFrame(CITY_ORIGIN, pyproj.CRS.from_user_input(CRS).to_wkt())
    with MapTiles(folder / "map", frame) as tiles:
        for returns in world.mapping.returns(pieces):
            tiles.write(returns)
            tick()
    _write_poses(folder / "map/trajectory.txt", *world.mapping.poses(), "T_map_vehicle")
    scans = (world.scan(epoch, scanner) for epoch in epochs)
    write_epochs(folder, epochs, scans, {files[name]: poses for name, poses in priors.items()}, tick)


def _changed(world: World, epochs: Sequence[Epoch], scanner: Scanner) -> str:
    """Line of the description: the ratio of the returns that months changed, over some 40 epochs, and how."""
    ratio = world.changed_ratio(epochs[:: math.ceil(len(epochs) / 40)], scanner)
    return f"changed = {ratio:.3f}  # {', '.join(f'{number} {change}' for change, number in world.changes.items())}\n"


def write_epochs(
    folder: Path, epochs: Sequence[Epoch], scans: Iterable[Returns], priors: Mapping[str, Sequence[Pose]],
    tick: Callable[[], None] = lambda: None,
) -> None:  # fmt: skip
    """Stream scans (city metres) to `folder`/scans, in the sensor frame; write times, reference poses and priors."""
    # There is one scan and one prior (T_city_sensor) per epoch; priors come by their files' names.
    place = folder / "scans"
    place.mkdir()
    for number, (epoch, returns) in enumerate(zip(epochs, scans, strict=True)):
        points_sensor = (returns.points - epoch.reference.position) @ epoch.reference.rotation
        rows = np.column_stack([points_sensor, returns.intensities]).astype("<f4")
        (place / f"{number:06d}.bin").write_bytes(rows.tobytes())
        tick()
    times = np.array([epoch.time for epoch in epochs])
    (place / "times.txt").write_text("".join(f"{time:.6f}\n" for time in times), encoding="utf-8", newline="\n")
    _write_poses(folder / "reference.txt", times, [epoch.reference for epoch in epochs], "T_map_sensor")
    for file, poses in priors.items():
        _write_poses(folder / file, times, poses, f"T_map_sensor, {Path(file).stem.replace('_', ' ')}")


def _write_poses(path: Path, times: NDArray[np.float64], poses: Sequence[Pose], what: str) -> None:
    """Write `poses`, T_city_x, in global coordinates as a TUM file; `what` they are goes into its comment."""
    poses_global = [pose.translated(CITY_ORIGIN) for pose in poses]
    write_tum(path, Trajectory.from_poses(times, poses_global), f"{what}, {CRS}, seconds of the week")


class MapTiles(ExitStack):
    """Open LAZ files (LAS 1.4, point format 6), one per square of 50 m, named by its lower left corner.

    frame: from city metres to global coordinates; its CRS must be known and is written into every file.
    """

    def __init__(self, folder: Path, frame: LocalFrame) -> None:
        import laspy
        import pyproj

        super().__init__()
        self._laspy, self._crs = laspy, pyproj.CRS.from_user_input(frame.crs)
        self._folder, self._frame = folder, frame
        self._writers: dict[tuple[int, int], Any] = {}

    def __exit__(self, *raised: Any) -> bool | None:
        with laz_as_os_error():
            return super().__exit__(*raised)

    def write(self, returns: Returns) -> None:
        """Append `returns` to the files they fall in."""
        points = self._frame.to_global(returns.points)
        tiles, numbers = np.unique(np.floor(points[:, :2] / TILE_EDGE).astype(np.int64), axis=0, return_inverse=True)
        for number, (east, north) in enumerate(tiles.tolist()):
            rows = np.flatnonzero(numbers.ravel() == number)
            writer = self._writers.get((east, north)) or self._open(east, north)
            record = self._laspy.ScaleAwarePointRecord.zeros(len(rows), header=writer.header)
            record.x, record.y, record.z = points[rows].T
            record.intensity = (returns.intensities[rows] * 65535.0).astype(np.uint16)
            record.classification = returns.classes[rows]
            record.gps_time = returns.times[rows]
            record.return_number[:] = 1
            record.number_of_returns[:] = 1
            with laz_as_os_error():
                writer.write_points(record)

    def _open(self, east: int, north: int) -> Any:
        corner = round(east * TILE_EDGE), round(north * TILE_EDGE)
        header = self._laspy.LasHeader(point_format=6, version="1.4")
        header.scales = np.full(3, RESOLUTION)
        header.offsets = np.array([*corner, 0.0])
        header.add_crs(self._crs)
        path = self._folder / "tile_{}_{}.laz".format(*corner)
        # Opened here: laspy leaves a file of its own open when the disk is full, and Python warns of that much later.
        stream = self.enter_context(path.open("w+b"))
        writer = self._laspy.open(stream, mode="w", header=header, do_compress=True, closefd=False)
        self._writers[east, north] = self.enter_context(writer)
        return self._writers[east, north]
