# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A build that fails or is killed leaves no map, and no other map changed."""

import errno
import os
import subprocess
import sys

import pytest
from built_maps import left_over

from maxcon import PointMap
from maxcon.errors import FileError, MapError
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


KILLED = """
import sys, time
import maxcon.mapping.build.build as build
put = build.MapWriter.put
def slowly(writer, record):
    put(writer, record)
    sys.stdout.write("wrote a tile\\n")
    sys.stdout.flush()
    time.sleep(60)
build.MapWriter.put = slowly
build.build_map([sys.argv[1]], sys.argv[2], n_threads=2)
"""


@pytest.mark.kills
def test_a_killed_build_leaves_no_map(tmp_path, cloud_files, scene):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    out = tmp_path / "a.map"
    with subprocess.Popen([sys.executable, "-c", KILLED, path, out], stdout=subprocess.PIPE, text=True) as build:
        try:
            first_line = build.stdout.readline()
        finally:
            build.kill()
        build.wait(10)
    assert first_line.startswith("wrote a tile")
    assert not out.exists()
    with pytest.raises(MapError, match=r"no manifest\.json"):
        PointMap.open(out)
    build_map([path], out)  # what the killed run left does not stand in the way
    assert PointMap.open(out).all_voxels()[1].sum() == len(scene)
