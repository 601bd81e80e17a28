"""A drive in the viewer Rerun, while it is localized, or as a recording (.rrd) for it; a map. See `with_rerun`."""

import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.drive.localize import EpochEstimate
from maxcon.drive.poses_table import PROTECTION_LEVELS
from maxcon.errors import MissingExtraError, OptionError
from maxcon.estimate import Status
from maxcon.export.pose_rows import covariance_of
from maxcon.export.scene import ELLIPSE, SCAN_POINTS, TILE_POINTS, CellScores, Scene, SceneEpoch
from maxcon.geometry import Pose
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.crs import crs_name
from maxcon.map import PointMap
from maxcon.map.layout import TileKey

EPOCH, STAMP = "epoch", "stamp"  # time lines: numbers of the scans, and their times
UNIX = 1e8  # times above are seconds since 1970, shown as dates; smaller ones count from somewhere else, s
PRIOR_COLOR, ANSWER_COLOR, NO_ANSWER_COLOR = (230, 120, 30), (70, 150, 255), (204, 121, 167)  # on black
SCORE_COLORS = [(13, 8, 135), (126, 3, 168), (204, 71, 120), (248, 149, 64), (240, 249, 33)]
"""Colours from the score 0 to the highest of an epoch, in even steps of its root: those of `--plot`."""
SCORES_NAME = "scores_of_cells"
ENLARGED = 100
ELLIPSE_NAME = f"ellipse_of_95_percent_{ENLARGED}_times_as_large"
HIGH = 12.0  # map points so far above the lowest of their tile are the lightest, m
PATIENCE = 10.0  # for the viewer to take what is left in the end, s


def find_viewer() -> str:
    """Return the viewer's program; MissingExtraError if there is none, OptionError without a display."""
    program = shutil.which("rerun", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if program is None:
        raise MissingExtraError("Expected the program rerun, the viewer, got none. pip install 'maxcon[view]'")
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OptionError(
            "Expected a display for --view, got none ($DISPLAY). Write a recording instead, --save drive.rrd, and open"
            " it with `rerun` where there is one."
        )
    return program


@contextmanager
def shown(
    epochs: Iterable[EpochEstimate], point_map: PointMap, near: NDArray[np.float64], save: Path | None,
    scored: Callable[[EpochEstimate], CellScores | None] = lambda epoch: None,
) -> Iterator[Iterator[EpochEstimate]]:  # fmt: skip
    """Yield the same epochs, each shown when it is asked for: in a recording, or a viewer if `save` is None."""
    with _opened(Scene.near(near, point_map.frame.crs, point_map), save, _blueprint(True)) as shown:

        def shown_once(epoch: EpochEstimate) -> EpochEstimate:
            shown.show(SceneEpoch.of_estimate(epoch, point_map.frame, scored(epoch)))
            return epoch

        yield map(shown_once, epochs)


def write_rerun(path: Path, scene: Scene, epochs: Iterable[SceneEpoch]) -> None:
    """Write a recording of the drive of a table of poses."""
    with _opened(scene, path, _blueprint(has_shares=False)) as shown:
        for epoch in epochs:
            shown.show(epoch)


def show_map(point_map: PointMap, save: Path | None) -> None:
    """Show all tiles of a map, in a recording, or a viewer if `save` is None."""
    keys = sorted(point_map.tile_keys)
    middle = np.append((np.mean(keys, axis=0) + 0.5) * point_map.tile_voxels * point_map.cell, 0.0)
    scene = Scene.near(point_map.frame.to_global(middle[None])[0], point_map.frame.crs, point_map)
    view = rrb.Spatial3DView(name="Map: dark below, light above", line_grid=False)
    about = rrb.TextDocumentView(name="About", origin="about")
    blueprint = rrb.Blueprint(rrb.Horizontal(view, about, column_shares=[5, 1]), collapse_panels=True)
    with _opened(scene, save, blueprint) as shown:
        shown.show_tiles(keys, len(keys))


@contextmanager
def _opened(scene: Scene, save: Path | None, blueprint: rrb.Blueprint) -> Iterator["_Shown"]:
    """Yield what shows epochs, in a viewer, or in a recording, in memory until all went well: 0.1 MB for each epoch."""
    stream = rr.RecordingStream("maxcon")
    stream.set_log_time_enabled(False)
    memory = None if save is None else stream.memory_recording()  # Rerun's own files wait forever on a full disk
    if memory is None:
        try:
            rr.spawn(connect=False, executable_path=find_viewer(), recording=stream)
        except RuntimeError as error:
            words = " ".join(str(error).split())
            raise OptionError(f"Expected the viewer to start, got: {words}. Write a recording (--save).") from error
        stream.connect_grpc()
    stream.send_blueprint(blueprint)
    try:
        yield _Shown(stream, scene)
    finally:
        content = b"" if memory is None else memory.drain_as_bytes()  # what is left there is warned of
    if save is not None:
        with atomic_file(save) as partial:
            partial.write_bytes(content)
    else:
        with suppress(RuntimeError):  # the viewer was closed meanwhile, as its user may
            stream.flush(timeout_sec=PATIENCE)


def _blueprint(has_shares: bool) -> rrb.Blueprint:
    """What opens: the scene with all answers up to the time shown, beside statuses, levels, shares and reasons."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    so_far = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(name, start=start, end=end) for name in (EPOCH, STAMP)])
    scene = rrb.Spatial3DView(
        name="Map (grey), scan at the prior (orange) and at the answer (blue)",
        overrides={"/answers": so_far, "/not_localized": so_far},
        eye_controls=rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, tracking_entity="/answers"),
        line_grid=False,
    )
    columns = rrb.TextLogColumns(timeline_columns=[EPOCH], text_log_columns=["LogLevel", "Body"])
    log = rrb.TextLogView(name="Log", origin="log", columns=columns)
    plots: list[Any] = [
        rrb.StateTimelineView(name="Status", origin="status"),
        rrb.TimeSeriesView(name="Protection level [m]", origin="protection"),
        *[rrb.TimeSeriesView(name="Share of the scan that matches", origin="share")] * has_shares,
        rrb.Tabs(log, rrb.TextDocumentView(name="About", origin="about")),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Vertical(*plots, row_shares=[1, 2, *[2] * has_shares, 3]), column_shares=[5, 3]),
        rrb.TimePanel(timeline=EPOCH, play_state="following", state="collapsed"),
        collapse_panels=True,
    )


class _Shown:
    """Epochs on a stream of Rerun, and which tiles of the map are there."""

    def __init__(self, stream: rr.RecordingStream, scene: Scene) -> None:
        self.stream, self.scene, self.shown, self.has_cells = stream, scene, set[TileKey](), False
        east, north, up = scene.origin
        words = (
            f"Coordinates: m from {east:.0f} m east, {north:.0f} m north, {up:.0f} m up ({crs_name(scene.crs)}).\n\n"
            f"Map: at most {TILE_POINTS:,} points of each tile near the drive. Scans: at most {SCAN_POINTS:,} points."
            f"\n\nEllipse: of 95 %, {ENLARGED} times as large as it is.\n\nScores of cells, if asked for (--scores): of"
            " the best heading at each place of the sensor, on a root scale, blue to yellow; searched exhaustively."
        )
        stream.log("about", rr.TextDocument(words), static=True)
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        colors = [ANSWER_COLOR if status is Status.LOCALIZED else NO_ANSWER_COLOR for status in Status]
        stream.log("status", rr.StateConfiguration(values=list(Status), colors=colors), static=True)

    def show(self, epoch: SceneEpoch) -> None:
        """Log an epoch; what it has not is cleared."""
        stream, row = self.stream, epoch.row
        stream.set_time(EPOCH, sequence=epoch.number)
        stream.set_time(STAMP, **{"timestamp" if row.time > UNIX else "duration": row.time})
        prior, answer = (None if pose is None else self.scene.local(pose) for pose in (epoch.prior, row.pose))
        around = row.pose or epoch.prior
        self.show_tiles(self.scene.tiles_around([] if around is None else [around]))
        self._show_cells(epoch.cells)
        self._show_scan("prior", prior, epoch, PRIOR_COLOR)
        self._show_scan("answer", answer, epoch, ANSWER_COLOR)
        self._show_ellipse(answer, covariance_of(row)[:2, :2])
        name, pose, color = ("answers", answer, ANSWER_COLOR) if answer else ("not_localized", prior, NO_ANSWER_COLOR)
        if pose is not None:
            stream.log(name, rr.Points3D([pose.position], colors=color, radii=rr.Radius.ui_points(3.5)))
        stream.log("status", rr.StateChange(state=row.status))
        stream.log("log", rr.TextLog(row.words, level=rr.TextLogLevel.INFO if answer else rr.TextLogLevel.WARN))
        for name in (*PROTECTION_LEVELS, "share"):
            if name in row.numbers:
                stream.log(name.replace("_", "/"), rr.Scalars(row.numbers[name]))

    def show_tiles(self, keys: Iterable[TileKey], n_tiles: int = 1) -> None:
        """Log tiles, of so many in all, that are not there yet: dark below, light above."""
        for key in keys:
            if key not in self.shown and len(points := self.scene.map_points([key], n_tiles)):
                heights = points[:, 2] - np.percentile(points[:, 2], 2)
                greys = (80.0 + 100.0 * np.clip(heights / HIGH, 0.0, 1.0)).astype(np.uint8)
                of_tile = rr.Points3D(points, colors=np.stack([greys] * 3, axis=1), radii=rr.Radius.ui_points(1.2))
                self.stream.log(f"map/tile_{key[0]}_{key[1]}", of_tile, static=True)
            self.shown.add(key)

    def _show_cells(self, cells: CellScores | None) -> None:
        """Log the scores of cells at their places; without any, that those of the epoch before are gone."""
        if cells is not None:
            ratios = np.sqrt(np.clip(np.nan_to_num(cells.scores / max(cells.scores.max(), 1e-300)), 0.0, 1.0))
            steps = np.linspace(0.0, 1.0, len(SCORE_COLORS))
            colors = np.column_stack([np.interp(ratios, steps, channel) for channel in np.transpose(SCORE_COLORS)])
            points = rr.Points3D(cells.places - self.scene.origin, colors=colors.astype(np.uint8), radii=cells.edge / 4)
            self.stream.log(SCORES_NAME, points, rr.DynamicArchetype("cells", components={"score": cells.scores}))
        elif self.has_cells:
            self.stream.log(SCORES_NAME, rr.Clear(recursive=False))
        self.has_cells = cells is not None

    def _show_scan(self, name: str, pose: Pose | None, epoch: SceneEpoch, color: tuple[int, int, int]) -> None:
        if pose is None:
            self.stream.log(name, rr.Clear(recursive=True))
            return
        turn = quaternions_from_angles(pose.roll, pose.pitch, pose.heading).ravel()
        at = rr.Transform3D(translation=pose.position, quaternion=rr.Quaternion(xyzw=turn))
        self.stream.log(name, at, rr.TransformAxes3D(3.0))
        self.stream.log(f"{name}/scan", rr.Points3D(epoch.points, colors=color, radii=rr.Radius.ui_points(1.8)))

    def _show_ellipse(self, answer: Pose | None, covariance: NDArray[np.float64]) -> None:
        if answer is None or not covariance.any():
            self.stream.log(ELLIPSE_NAME, rr.Clear(recursive=False))
            return
        variances, axes = np.linalg.eigh(covariance)
        turns = np.linspace(0.0, 2.0 * np.pi, 65)
        circle = np.column_stack([np.cos(turns), np.sin(turns)])
        ellipse = (ENLARGED * ELLIPSE * np.sqrt(np.maximum(variances, 0.0)) * circle) @ axes.T
        outline = answer.position + np.column_stack([ellipse, np.zeros(len(turns))])
        self.stream.log(ELLIPSE_NAME, rr.LineStrips3D([outline], colors=ANSWER_COLOR))
