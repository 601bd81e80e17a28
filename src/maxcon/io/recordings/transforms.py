"""Transforms between frames (TF) in a recording: the pose of one frame in another, over time or static."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, OptionError, TrajectoryError
from maxcon.geometry import Pose, interpolate_poses
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.recording import Recording, Topic, decode_message, frame_name, frame_of, stamp_of
from maxcon.io.text import printable
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")  # types of messages that hold transforms
STATIC = "tf_static"  # end of the names of topics with static transforms
LARGEST_GAP = 2.0  # largest time between two transforms of a pair of frames to interpolate across, s


def contents(recording: Recording, topics: Sequence[Topic], what: str) -> Iterator[tuple[str, float, Any]]:
    """Yield topic, time (s) and content of messages; FileError at one that cannot be decoded, `what` is in messages."""
    for message in recording.messages([topic.name for topic in topics]) if topics else ():
        with as_file_error(Path(f"{recording.path}, {printable(message.topic)}"), what):
            content = decode_message(message)
            stamped = content.transforms if message.type in TRANSFORMS else [content]
            pairs = [(stamp_of(one, message.recorded) / 1e9, one) for one in stamped]
        for time, one in pairs:
            yield message.topic, time, one


def numbers_of(position: Any, turn: Any) -> list[float]:
    """Return x, y, z, qx, qy, qz, qw of two parts of a message."""
    return [float(value) for value in (position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w)]


def parse_frames(text: str, option: str) -> tuple[str, str]:
    """Return the two frames of "map:base_link"; OptionError if these are not two names."""
    frames = tuple(frame_name(part) for part in text.split(":"))
    if len(frames) != 2 or not all(frames):
        raise OptionError(f"Expected {option} as FIXED:MOVING, two frames, got {text!r}. For instance map:base_link.")
    return frames[0], frames[1]


@dataclass(slots=True)
class _Link:
    """Transforms from a frame to its parent: rows of time, x, y, z, qx, qy, qz, qw."""

    child: str
    parent: str
    is_static: bool
    rows: array[float] = field(default_factory=lambda: array("d"))

    def table(self) -> NDArray[np.float64]:
        """The rows by time, each time once; of a static link the last one."""
        values = np.frombuffer(self.rows).reshape(-1, 8)
        return values[-1:] if self.is_static else values[np.unique(values[:, 0], return_index=True)[1]]


_Path = list[tuple[_Link, bool]]  # links between two frames, passed from parent to child (`is_down`), or upwards


class TransformTree:
    """All transforms of a recording: the links of each frame to its parents, by its name."""

    def __init__(self, recording: Recording, *, is_static_only: bool = False) -> None:
        links: dict[str, dict[str, _Link]] = {}
        topics = [t for t in recording.of_type(*TRANSFORMS) if not is_static_only or t.name.endswith(STATIC)]
        for topic, time, content in contents(recording, topics, "messages of transforms"):
            is_static = topic.endswith(STATIC)
            child, parent = frame_name(content.child_frame_id), frame_of(content)
            link = links.setdefault(child, {}).setdefault(parent, _Link(child, parent, is_static))
            link.is_static &= is_static  # on both topics it moves: its static transform counts as a pose
            row = [time, *numbers_of(content.transform.translation, content.transform.rotation)]
            if np.isfinite(row).all() and abs(np.linalg.norm(row[4:]) - 1.0) < 0.01:
                link.rows.extend(row)
        known = {child: [link for link in several.values() if link.rows] for child, several in links.items() if child}
        self.path, self._links = recording.path, {child: several for child, several in known.items() if several}

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames, sorted."""
        parents = {link.parent for several in self._links.values() for link in several}
        return tuple(sorted(parents | set(self._links)))

    def trajectory(self, fixed: str, moving: str) -> tuple[Trajectory, str]:
        """Return T_fixed_moving at the times of all moving links, as far as all reach; and the path between both."""
        steps = self._path(fixed, moving)
        moved = [link.table() for link, _ in steps if not link.is_static]
        words = " -> ".join([fixed, *(link.child if is_down else link.parent for link, is_down in steps)])
        if not moved:
            raise FileError(
                f"Expected frames of {self.path} that move, to take poses from /tf, got {printable(words)}, which is"
                " static. Choose other frames."
            )
        times = _common_times(moved)
        if not len(times):
            raise TrajectoryError(
                f"Expected transforms of {printable(words)} in {self.path} at common times, got none less than"
                f" {LARGEST_GAP:g} s apart. Choose other frames, or another recording."
            )
        positions, turns = _composed(steps, times)
        return Trajectory(times, positions, turns.as_quat()), words

    def static_pose(self, fixed: str, moving: str) -> Pose | None:
        """Return T_fixed_moving if both frames are there and only static links between them; else None."""
        if fixed == moving:
            return Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        try:
            steps = self._path(fixed, moving)
        except (FileError, OptionError):
            return None
        if not all(link.is_static for link, _ in steps):
            return None
        positions, turns = _composed(steps, np.zeros(1))
        return Pose.from_rotation(positions[0], turns.as_matrix()[0])

    def _path(self, fixed: str, moving: str) -> _Path:
        """The links from one frame to another: up to their first common ancestor, and down."""
        frames = self.frames
        for frame in (fixed, moving):
            if frame not in frames:
                listed = ", ".join(printable(name) for name in frames[:12])
                raise OptionError(f"Expected a frame of {self.path}, got {frame!r}. It has {listed or 'none'}.")
        up, down = self._ancestors(fixed), self._ancestors(moving)
        shared = next((frame for frame in up if frame in down), None)
        if shared is None or fixed == moving:
            raise FileError(
                f"Expected transforms of {self.path} between {printable(fixed)} and {printable(moving)}, got none."
                " Choose other frames."
            )
        rising = [(self._only(child), False) for child in up[: up.index(shared)]]
        return rising + [(self._only(child), True) for child in down[: down.index(shared)]][::-1]

    def _ancestors(self, frame: str) -> list[str]:
        """The frame, its parent, and so on; ends where frames come again."""
        found = [frame]
        while found[-1] in self._links and (parent := self._only(found[-1]).parent) not in found:
            found.append(parent)
        return found

    def _only(self, child: str) -> _Link:
        several = self._links[child]
        if len(several) > 1:
            parents = ", ".join(printable(link.parent) for link in several[:4])
            raise FileError(
                f"Expected one parent of the frame {printable(child)} in {self.path}, got {parents}. Record the"
                " transforms of one source."
            )
        return several[0]


def _common_times(tables: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """All times of some links, as far as all of them reach, without those in a gap of any."""
    times = np.unique(np.concatenate([table[:, 0] for table in tables]))
    for table in tables:
        own = table[:, 0]
        later = np.searchsorted(own, times)
        before, after = own[np.maximum(later - 1, 0)], own[np.minimum(later, len(own) - 1)]
        is_between = (later > 0) & (later < len(own)) & (after - before <= LARGEST_GAP)
        times = times[(after == times) | is_between]
    return times


def _composed(steps: _Path, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], Rotation]:
    """Positions and rotations of the end of a path at some times."""
    from scipy.spatial.transform import Rotation

    positions, turns = np.zeros((len(times), 3)), Rotation.identity(len(times))
    for link, is_down in steps:
        table = link.table()
        own, turn = interpolate_poses(table[:, 0], table[:, 1:4], table[:, 4:], times)
        if not is_down:
            turn = turn.inv()
            own = -turn.apply(own)
        positions, turns = positions + turns.apply(own), turns * turn
    return positions, turns
