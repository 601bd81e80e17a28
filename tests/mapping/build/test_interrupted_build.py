# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A build that fails or is killed leaves no map, and no other map changed."""

import errno
import os

import pytest
from built_maps import left_over

from maxcon import PointMap
from maxcon.errors import FileError
from maxcon.map.manifest import read_manifest
from maxcon.map.store import MapWriter
from maxcon.mapping.build import build_map


@pytest.mark.parametrize("where", ["put", "finish"])
def test_a_broken_source_and_a_full_disk_leave_nothing_behind(tmp_path, cloud_files, scene, monkeypatch, where):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    build_map([path], tmp_path / "old.map")
    before = read_manifest(tmp_path / "old.map").sha256

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    broken = cloud_files.las(tmp_path / "broken.las", scene)
    broken.write_bytes(broken.read_bytes()[:-1000])
    with pytest.raises(FileError, match=r"broken\.las"):
        build_map([path, broken], tmp_path / "new.map")
    monkeypatch.setattr(MapWriter, where, full)
    for name, overwrite in (("new.map", False), ("old.map", True)):
        with pytest.raises(FileError, match=rf"able to write .*{name}, got: No space left on device\..*disk space"):
            build_map([path], tmp_path / name, overwrite=overwrite)
    assert left_over(tmp_path) == ["a.npz", "broken.las", "old.map"]
    assert read_manifest(tmp_path / "old.map").sha256 == before
    PointMap.open(tmp_path / "old.map").all_voxels()
