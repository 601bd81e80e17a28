# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import maxcon
from maxcon.errors import OptionError

POSES = [maxcon.Pose(float(x), 0.5, 0.0, 0.0, 0.0, 0.1 * x) for x in range(-4, 5)]


def _trajectory(poses):
    return maxcon.Trajectory.from_poses(np.arange(float(len(poses))), poses)


def test_poses_are_drawn_the_same_each_time(tmp_path, epoch):
    for name in ("a.svg", "b.svg"):
        maxcon.plot_poses(tmp_path / name, _trajectory(POSES), epoch.point_map, prior=_trajectory(POSES[:2]))
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert ElementTree.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")


def test_a_single_pose_is_drawn(tmp_path, epoch):
    maxcon.plot_poses(tmp_path / "one.png", _trajectory(POSES[:1]), epoch.point_map)
    assert (tmp_path / "one.png").read_bytes()[:4] == b"\x89PNG"


def test_other_kinds_of_pictures_are_refused(tmp_path, epoch):
    with pytest.raises(OptionError, match="png or"):
        maxcon.plot_poses(tmp_path / "one.jpg", _trajectory(POSES), epoch.point_map)
    assert list(tmp_path.iterdir()) == []
