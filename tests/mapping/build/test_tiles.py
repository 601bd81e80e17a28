"""A map is the same to the byte, whoever makes its tiles, and however often they end over it."""

import sys
from contextlib import suppress

import numpy as np
import pytest
from built_maps import files_of

from maxcon._system.engine import Engine
from maxcon.errors import MapError
from maxcon.map import PointMap
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.found_classes import OBSERVATION, observation_records
from maxcon.mapping.build.tile_points import POINT, TileBuckets, point_records
from maxcon.mapping.build.tiles import TileJob, TileStep, in_threads

if sys.platform == "win32":
    pytest.skip("no POSIX signals to kill a worker with", allow_module_level=True)

CELL, N_POINTS = 0.06, 123_000
OPTIONS = {"plain": MapOptions(classify="off"), "classes found": MapOptions(classify="always")}


@pytest.fixture(scope="module")
def street():
    """A road and the house beside it, in ten tiles; seen twice, a car the first time only. Points and times."""
    rng = np.random.default_rng(0)

    def spread(n, low, high):
        return rng.uniform(low, high, (n, 3))

    once = [spread(30_000, [0.0, 0.0, 0.0], [100.0, 40.0, 0.02]), spread(30_000, [0.0, 35.0, 0.0], [100.0, 35.02, 6.0])]
    car = spread(3_000, [40.0, 10.0, 0.3], [44.0, 12.0, 1.5])
    points = np.concatenate([*once, car, *once])
    times = np.concatenate([np.full(63_000, 5.0), np.full(60_000, 500.0)])
    return points + [458_000.0, 5_428_000.0, 100.0], times


@pytest.fixture
def cloud(street, cloud_files, tmp_path):
    return cloud_files.las(tmp_path / "street.laz", street[0], times=street[1])


@pytest.mark.clusters
@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_two_workers_make_the_map_that_threads_make(cloud, options, tmp_path):
    build_map([cloud], tmp_path / "threads.map", options, n_threads=2)
    build_map([cloud], tmp_path / "workers.map", options, engine=Engine(2))
    assert files_of(tmp_path / "workers.map") == files_of(tmp_path / "threads.map")
    n_points = PointMap.open(tmp_path / "workers.map").all_voxels()[1].sum()
    assert n_points == N_POINTS if options.classify == "off" else 0.4 * N_POINTS < n_points <= N_POINTS
    assert sorted(path.name for path in tmp_path.iterdir()) == ["street.laz", "threads.map", "workers.map"]


def kill_a_worker():
    """Kill one of the processes that this one's cluster has started; return whether there was one."""
    import psutil

    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # it ended by itself
            if any("spawn_main" in word for word in child.cmdline()):
                child.kill()
                return True
    return False


@pytest.mark.kills
def test_workers_that_are_killed_change_nothing(cloud, tmp_path):
    """One of them after every third tile, at each step."""
    kills = []

    def kill(step, done, total):
        if step == "making tiles" and done % 3 == 1 and done < total:
            kills.append(kill_a_worker())

    options = OPTIONS["classes found"]
    build_map([cloud], tmp_path / "threads.map", options)
    build_map([cloud], tmp_path / "workers.map", options, engine=Engine(2), progress=kill)
    assert sum(kills) > 3
    assert files_of(tmp_path / "workers.map") == files_of(tmp_path / "threads.map")


@pytest.fixture
def sorted_points(street, tmp_path):
    """The points of the street on disk, as a build sorts them for others; the job, and the keys of its tiles."""
    points = street[0] - [458_000.0, 5_428_000.0, 100.0]
    buckets, seen = TileBuckets(tmp_path, POINT, "points"), TileBuckets(tmp_path, OBSERVATION, "seen")
    buckets.add(*point_records(points, np.zeros(points.shape, np.float32), CELL))
    seen.add(*observation_records(points, street[1], CELL))
    buckets.complete(to_disk=True)
    seen.complete(to_disk=True)
    return TileJob(tmp_path, CELL, False, False, finds_surfaces=True, drop=frozenset()), buckets.keys


def test_every_step_may_be_done_twice_each_by_another_process_and_tiles_wait_in_files(sorted_points):
    """A tile that takes long, or ends its workers, lets all others wait: they must not do so in memory."""
    job, keys = sorted_points
    with pytest.raises(FileNotFoundError):  # and not an empty tile
        job.open()((TileStep.GATHER, ((99, 99),)))
    for part in (keys[:3], keys[2:]):  # the third by one that took over, too
        job.open()((TileStep.GATHER, tuple(part)))
    once, twice = (job.open()((TileStep.FIND_CLASSES, tuple(keys))) for _ in range(2))
    assert [found.n_points for found in once] == [found.n_points for found in twice]
    made = []
    for _ in range(2):
        waiting = job.open()((TileStep.MAKE, tuple(keys)))
        assert all(tile.record.content == b"" for tile in waiting)
        made.append([job.fetched(tile) for tile in waiting])
    assert [tile.record for tile in made[0]] == [tile.record for tile in made[1]]
    assert all(len(tile.record.content) > 1000 for tile in made[0])
    assert sum(tile.record.n_points for tile in made[0]) == N_POINTS
    assert not list(job.folder.glob("*.record"))


def test_a_map_without_one_of_its_tiles_is_refused_and_a_folder_that_a_worker_does_not_see(tmp_path):
    job = TileJob(tmp_path / "no", CELL, has_normals=False, is_signed=False)
    task = (TileStep.MAKE, ((3, -4), (5, 6)))
    one, _ = job.split(task)
    assert one == (TileStep.MAKE, ((3, -4),))
    with pytest.raises(MapError, match=r"Expected to make all tiles of the map, but of tile \(3, -4\) it crashes"):
        job.lost(one, "it crashes")
    with pytest.raises(MapError, match=r"Expected all workers to see .*no, got one on .* that does not"):
        job.open()


def test_one_worker_is_this_process_with_one_thread(cloud, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "maxcon.mapping.build.tiles.in_threads",
        lambda work, keys, n_threads: asked.append(n_threads) or in_threads(work, keys, n_threads),
    )
    build_map([cloud], tmp_path / "a.map", engine=Engine(1))
    assert set(asked) == {1}
