"""A map as points: what laspy and our own reader of PLY find in the files is what is in the map."""

from dataclasses import replace

import laspy
import numpy as np
import pytest

from maxcon import PointMap
from maxcon.errors import OptionError
from maxcon.export import export_map, points
from maxcon.map.layout import SurfaceClass
from maxcon.mapping.build import MapOptions, build_map
from written_las import write_las
from written_maps import stored_voxels

RNG = np.random.default_rng(0)
CRS, CORNER = "EPSG:25832", np.array([550_000.0, 5_802_000.0, 60.0])


@pytest.fixture(scope="module")
def city(tmp_path_factory):
    """A map of a wall of 40 m, over two tiles, on ground."""
    folder = tmp_path_factory.mktemp("map")
    x = RNG.uniform(0.0, 40.0, 20_000)
    wall = np.column_stack([x, np.full(x.size, 5.0), RNG.uniform(0.0, 2.0, x.size)])
    floor = np.column_stack([x, RNG.uniform(0.0, 4.0, x.size), np.zeros(x.size)])
    write_las(folder / "cloud.laz", np.concatenate([wall, floor]) + CORNER, classes=np.repeat([6, 2], x.size))
    build_map([folder / "cloud.laz"], folder / "city.map", MapOptions(crs=CRS, cell=0.06))
    return folder / "city.map"


@pytest.fixture(scope="module")
def voxels(city):
    """Means in the CRS, counts and normals, tile by tile."""
    assert len(PointMap.open(city).tile_keys) > 1
    return stored_voxels(city)[:3]


@pytest.mark.parametrize("suffix", [".laz", ".las"])
def test_las_has_voxels_and_ground_with_all_that_is_known_of_them(city, voxels, suffix, tmp_path):
    n_voxels, n_heights = export_map(city, tmp_path / f"a{suffix}")
    found = laspy.read(tmp_path / f"a{suffix}")
    places, counts, normals = voxels
    assert n_voxels == len(places) and len(found) == n_voxels + n_heights
    assert found.header.parse_crs().to_epsg() == 25832
    is_ground = np.asarray(found.classification) == 2
    assert np.count_nonzero(is_ground) == n_heights > 500
    np.testing.assert_allclose(found.xyz[~is_ground], places, atol=0.0006)
    np.testing.assert_array_equal(found["count"][~is_ground], counts)
    of_axes = np.column_stack([found[f"Normal{axis}"] for axis in "XYZ"])
    np.testing.assert_array_equal(of_axes[~is_ground], normals)
    np.testing.assert_allclose(found.z[is_ground], CORNER[2], atol=0.0006)
    low, high = (CORNER + [0.0, 0.0, 0.0], CORNER + [40.0, 4.0, 0.0])
    assert (np.abs(found.xyz[is_ground] - (low + high) / 2)[:, :2] <= (high - low)[:2] / 2 + 0.25).all()
    assert not of_axes[is_ground].any() and not found["change"].any()


def test_ply_has_the_same_points_and_their_crs(city, voxels, tmp_path):
    n_voxels, n_heights = export_map(city, tmp_path / "a.ply")
    header, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    assert b"25832" in header and b"comment crs PROJCRS" in header.replace(b"COMPOUNDCRS", b"PROJCRS")
    kinds = {"double": "<f8", "float": "<f4", "int": "<i4", "uchar": "u1"}
    words = [line.split() for line in header.decode().splitlines() if line.startswith("property")]
    found = np.frombuffer(body, np.dtype([(name, kinds[kind]) for _, kind, name in words]))
    assert len(found) == n_voxels + n_heights
    np.testing.assert_allclose(np.column_stack([found[axis] for axis in "xyz"])[:n_voxels], voxels[0], atol=1e-9)
    np.testing.assert_array_equal(found["count"][:n_voxels], voxels[1])
    np.testing.assert_array_equal(np.unique(found["class"]), [1, 2])


def test_what_is_gone_of_an_updated_map_is_written_and_says_so(city, monkeypatch, tmp_path):
    read = points.stored_tiles

    def updated(*arguments, **keywords):
        tiles = read(*arguments, **keywords)
        load = tiles.load
        tiles.load = lambda key: replace(tile := load(key), classes=np.full(len(tile), SurfaceClass.GONE, np.uint8))
        return tiles

    monkeypatch.setattr(points, "stored_tiles", updated)
    n_voxels, _ = export_map(city, tmp_path / "a.laz")
    assert np.count_nonzero(laspy.read(tmp_path / "a.laz")["change"] == 1) == n_voxels


def test_a_map_without_a_crs_and_a_suffix_that_is_none(tmp_path):
    np.savez(tmp_path / "a.npz", points=RNG.uniform(0.0, 3.0, (3000, 3)))
    build_map([tmp_path / "a.npz"], tmp_path / "a.map", MapOptions(classify="off", cell=0.06))
    export_map(tmp_path / "a.map", tmp_path / "a.laz")
    assert laspy.read(tmp_path / "a.laz").header.parse_crs() is None
    with pytest.raises(OptionError, match=r"\.laz, \.las, \.ply, got .*a\.xyz"):
        export_map(tmp_path / "a.map", tmp_path / "a.xyz")
