"""`maxcon map georeference`."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.flags import OptionGroup, argument, check_needs, flag, flags
from maxcon.cli.options import AllowInexactCrs, GeoidHeight, Quiet
from maxcon.cli.terminal import compiling_told, print_rows, step_bars
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.mapping.georeference import Georeference, Places


MOST_NAMED = 5  # outliers


class PlaceOptions(OptionGroup):
    """What is known of where a map lies.

    gnss: Positions of a receiver: NMEA, CSV (latitude, longitude), a recording; TUM, CSV in the CRS.
    trajectory: Where the scanner was in the map, at the receiver's times, or poses for --poses-out.
    mounting: Where [sensor] and [prior], the antenna, are in the vehicle; else at one place.
    control: Control points: name; x,y,z in the map; east,north,height in the CRS; sigma, else 0.05 m.
    level_sigma_deg: How well the map's z axis is known to be up, as of LiDAR-inertial programs, degrees.
    """

    map_folder: Path = argument(..., "Map in coordinates of its own, of a SLAM program for example.", "MAP")
    crs: str = flag(..., "CRS of the new map, in metres.", metavar="EPSG:N|WKT")
    out: Path = flag(..., "Folder of the map to write.", "--out", "-o", metavar="MAP2")
    gnss: Path | None = flag(None, metavar="FILE")
    trajectory: Path | None = flag(None, metavar="TUM|CSV")
    mounting: Path | None = flag(None, metavar="TOML")
    gnss_topic: str | None = flag(None, "Which positions of a recording.", metavar="NAME")
    geoid_height: GeoidHeight = None
    allow_inexact_crs: AllowInexactCrs = False
    control: Path | None = flag(None, metavar="CSV")
    level_sigma_deg: float | None = flag(None, metavar="DEG")
    with_scale: bool = flag(False, "Distances in the map may be off by a factor, too.")
    residuals: Path | None = flag(None, "Also write the residuals.", metavar="CSV")
    picture: Path | None = flag(None, "Also draw them.", metavar="PNG|SVG")
    poses_out: Path | None = flag(None, "Also write the trajectory in the CRS.", metavar="TUM")
    overwrite: bool = flag(False, "Replace MAP2 if there is one.")

    def __post_init__(self) -> None:
        gnss, poses = {"--gnss": self.gnss}, {"--poses-out": self.poses_out}
        check_needs(gnss | poses, {"--trajectory": self.trajectory})
        check_needs({"--trajectory": self.trajectory}, gnss | poses)
        of_gnss = {"--mounting": self.mounting, "--gnss-topic": self.gnss_topic, "--geoid-height": self.geoid_height}
        check_needs(of_gnss, gnss)
        if self.gnss is None and self.control is None:
            raise OptionError("Expected --gnss or --control, to tell where the map lies, got neither. Give one.")
        if self.level_sigma_deg is not None and not 0.0 < self.level_sigma_deg <= 90.0:
            raise OptionError(f"Expected --level-sigma-deg above 0, up to 90, got {self.level_sigma_deg}. Usual: 0.3.")

    def places(self) -> "tuple[Places, ...]":
        """Return the same places in the map and in the CRS."""
        from maxcon.cli.drive_inputs import read_rough_poses
        from maxcon.io.trajectories import read_trajectory
        from maxcon.map.manifest import read_manifest
        from maxcon.mapping.georeference import places_of_fixes, read_control_points
        from maxcon.scan.mounting import read_mounting, sensor_trajectory

        found = [] if self.control is None else [read_control_points(self.control)]
        if self.gnss is not None and self.trajectory is not None:
            antenna = read_trajectory(self.trajectory)
            if self.mounting is not None:
                mounting = read_mounting(self.mounting)
                antenna = sensor_trajectory(antenna, mounting.T_vehicle_sensor.inverse @ mounting.T_vehicle_prior)
            asked, topic = {"--gnss-topic": self.gnss_topic}, self.gnss_topic
            fixes = read_rough_poses(self.gnss, self.crs, self.geoid_height, asked, topic=topic, are_sure=True)
            operation = fixes.operation
            # A receiver's places are in the datum of its corrections: an operation that moves none is no fault.
            is_safe = operation is None or not (operation.moves or operation.accuracy < 0.0)
            if operation is not None and not (is_safe or self.allow_inexact_crs):
                operation.check(read_manifest(self.map_folder).cell, str(self.gnss))
            found.append(replace(places_of_fixes(antenna, fixes.trajectory), operation=operation))
        return tuple(found)


@flags
def georeference(what: PlaceOptions, quiet: Quiet = False) -> None:
    """Write a map in the coordinates of a CRS, where positions of a receiver, or control points, say that it lies."""
    from maxcon.cli.map_words import print_manifest
    from maxcon.io.crs import metric_crs
    from maxcon.io.trajectories import read_trajectory, write_tum
    from maxcon.mapping.derived_maps import move_map
    from maxcon.mapping.georeference import georeference as placed_by
    from maxcon.plotting.poses import plot_residuals

    crs, level = metric_crs(what.crs), what.level_sigma_deg and math.radians(what.level_sigma_deg)
    found = placed_by(what.places(), with_scale=what.with_scale, level_sigma=level)
    rows = _rows(found)
    print_rows(rows)
    if what.residuals is not None:
        _write_residuals(what.residuals, found)
    if what.picture is not None:
        measured, words = found.apply(found.local) + found.residuals, f"{rows[-2][1]}\n{rows[-1][1]}"
        plot_residuals(what.picture, measured, found.residuals, found.are_outliers, words)
    if what.poses_out is not None and what.trajectory is not None:
        write_tum(what.poses_out, found.of_poses(read_trajectory(what.trajectory)))
    with step_bars(quiet) as report, compiling_told(quiet):
        manifest = move_map(what.map_folder, found, crs, what.out, overwrite=what.overwrite, progress=report)
    typer.echo(f"{what.out}")
    print_manifest(manifest)


def _rows(found: "Georeference") -> list[tuple[str, str]]:
    """How a map is placed, and how well: names and words."""
    import numpy as np

    heading = math.degrees(math.atan2(found.rotation[1, 0], found.rotation[0, 0]))
    tilt = math.degrees(math.acos(min(1.0, found.rotation[2, 2])))
    scale = f", {1e6 * (found.scale - 1.0):+.0f} mm per km" if found.scale != 1.0 else ""
    good = np.abs(found.residuals[~found.are_outliers])
    across = np.hypot(good[:, 0], good[:, 1])
    east, north, up = found.sigmas_of_turns_deg
    names, alike = [name for each in found.places for name in each.names], found.n_alike
    out = [name for name, is_out in zip(names, found.are_outliers, strict=True) if is_out]
    which = f" ({', '.join(out)})" if 0 < len(out) <= MOST_NAMED else ""
    return [
        ("turned", f"{heading:.3f} degrees about up, {tilt:.3f} degrees from up{scale}"),
        ("residuals", f"median {np.median(across):.3f} m, 95 % {np.quantile(across, 0.95):.3f} m; heights"
         f" {np.median(good[:, 2]):.3f} and {np.quantile(good[:, 2], 0.95):.3f} m; {len(out)} of {len(names)} places"
         f" are outliers{which}" + (f"; {alike:.0f} fixes in a row err alike" if alike >= 1.5 else "")),
        ("known to", f"{found.sigma:.3f} m in the mean over these places; turns to {east:.3f}, {north:.3f} degrees"
         f" about east and north, {up:.3f} about up"),
    ]  # fmt: skip


def _write_residuals(path: Path, found: "Georeference") -> None:
    import numpy as np

    from maxcon._system.atomic import atomic_file

    names = [name for each in found.places for name in each.names]
    measured = found.apply(found.local) + found.residuals
    columns = "name east north height residual_east residual_north residual_up sigma sigma_up is_outlier"
    with atomic_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns.split())
        values = np.column_stack([measured, found.residuals, found.sigmas[:, [0, 2]]])
        for name, row, is_outlier in zip(names, values.tolist(), found.are_outliers, strict=True):
            writer.writerow([name, *(f"{value:.4f}" for value in row), int(is_outlier)])
