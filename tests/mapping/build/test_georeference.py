"""Maps in another CRS than their clouds, and of a part of them: feet, degrees, geocentric coordinates, heights."""

import re
from dataclasses import replace

import numpy as np
import pyproj
import pytest

from maxcon import PointMap
from maxcon.cli.map_words import inexact_words
from maxcon.errors import CrsError, MapError, OptionError
from maxcon.io.clouds import open_cloud
from maxcon.io.crs import Operation, PointTransform
from maxcon.mapping.build import Area, MapOptions, build_map

UTM, GAUSS_KRUEGER = "EPSG:25832", "EPSG:31467"
OF_UNKNOWN_ACCURACY = "+proj=tmerc +lon_0=9 +ellps=bessel +towgs84=598,73,418,0.2,0,-2.4,6.7 +type=crs"
FOOT = 1200.0 / 3937.0


@pytest.fixture
def points():
    rng = np.random.default_rng(3)
    return np.array([550_000.0, 5_802_000.0, 60.0]) + rng.uniform(0, 40, (3000, 3))


def _other(points, crs):
    """The points in another plane CRS, heights as they are."""
    x, y = pyproj.Transformer.from_crs(UTM, crs, always_xy=True).transform(points[:, 0], points[:, 1])
    return np.column_stack([x, y, points[:, 2]])


def _voxels(path):
    point_map = PointMap.open(path)
    indices, counts, _ = point_map.all_voxels()
    corner = np.asarray(point_map.frame.origin) + indices * point_map.cell
    return {tuple(np.round(row, 3)): int(n) for row, n in zip(corner, counts, strict=True)}


def _shared(one, other):
    return len(one.keys() & other.keys()) / len(one)


@pytest.mark.parametrize("crs", ["EPSG:25833", "EPSG:4258"])
def test_points_of_another_crs_are_where_they_would_be(tmp_path, cloud_files, points, crs):
    """And those of several in one map."""
    here = cloud_files.npz(tmp_path / "here.npz", points)
    there = cloud_files.npz(tmp_path / "there.npz", _other(points[:1500], crs))
    rest = cloud_files.las(tmp_path / "rest.laz", points[1500:], crs=UTM, scale=0.0001)
    build_map([here], tmp_path / "here.map", MapOptions(crs=UTM))
    manifest = build_map([there, rest], tmp_path / "there.map", MapOptions(crs=crs, to_crs=UTM))
    assert _shared(_voxels(tmp_path / "here.map"), _voxels(tmp_path / "there.map")) > 0.98  # 0.1 mm of the projection
    assert pyproj.CRS(manifest.crs).to_epsg() == 25832
    assert manifest.build["sources"][0]["transform"].startswith("from ")
    assert manifest.n_points == 3000


def test_feet_degrees_and_geocentric_coordinates_become_metres(points):
    """New York in feet of the US survey: what no CRS says of heights is in the unit of the plane."""
    plane = pyproj.Transformer.from_crs("EPSG:2263", "EPSG:32618", always_xy=True).transform(1_000_000.0, 200_000.0)
    place = np.array([[1_000_000.0, 200_000.0, 100.0]])
    for crs, height in (("EPSG:2263", 100.0 * FOOT), ("EPSG:2263+6360", 100.0 * FOOT), ("EPSG:2263+5703", 100.0)):
        np.testing.assert_allclose(PointTransform(crs, "EPSG:32618").apply(place), [[*plane, height]])
    assert "heights times 0.3048006096" in PointTransform("EPSG:2263", "EPSG:32618").words
    degrees = PointTransform("EPSG:4326", "EPSG:32632").apply(np.array([[9.0, 52.0, 61.0]]))
    np.testing.assert_allclose(degrees[0, [0, 2]], [500_000.0, 61.0], atol=1e-6)
    geocentric = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(9.0, 52.0, 61.0)
    placed = PointTransform("EPSG:4978", "EPSG:32632").apply(np.array([geocentric]))
    np.testing.assert_allclose(placed, degrees, atol=1e-6)
    for crs in (UTM, "EPSG:25832+7837"):
        np.testing.assert_array_equal(PointTransform(crs, UTM).apply(points), points)


def test_heights_are_not_mixed(tmp_path, cloud_files, points):
    with pytest.raises(CrsError, match="whose CRS says what heights are"):
        PointTransform(UTM, "EPSG:25832+7837")
    one = cloud_files.las(tmp_path / "a.laz", points, crs=UTM)
    two = cloud_files.las(tmp_path / "b.laz", points, crs="EPSG:25832+7837")
    with pytest.raises(CrsError, match=r"no stated reference in .*a\.laz and of DHHN2016 height in .*b\.laz"):
        build_map([one, two], tmp_path / "x.map", MapOptions(to_crs=UTM))


def test_what_cannot_be_transformed_is_refused(tmp_path, cloud_files, points):
    none = cloud_files.npz(tmp_path / "none.npz", points)
    for options, kind, words in (
        ({"to_crs": UTM}, CrsError, r"none\.npz.*got none\. Say which it is with --crs"),
        ({"crs": UTM, "to_crs": "EPSG:4326"}, CrsError, "projected CRS in metres, got WGS 84"),
        ({"crs": UTM, "to_crs": "EPSG:2263"}, CrsError, "projected CRS in metres"),
        ({"crs": "EPSG:4326", "to_crs": UTM}, MapError, "3,000 have no finite coordinates"),
    ):
        with pytest.raises(kind, match=words):
            build_map([none], tmp_path / "x.map", MapOptions(**options))
    with pytest.raises(OptionError, match="--signed-normals or --to-crs"):
        MapOptions(to_crs=UTM, normals_have_sides=True)
    assert not (tmp_path / "x.map").exists()


@pytest.mark.parametrize(("source", "place", "words", "moves"), [
    (GAUSS_KRUEGER, (3458833.0, 5430000.0), r"DHDN to ETRS89.*, exact to .* m \(more exact with \w+\.tif: `", True),
    ("EPSG:4326", (8.4, 49.0), r"ETRS89 to WGS 84 .*, exact to 1 m$", False),
    (OF_UNKNOWN_ACCURACY, (0.0, 5400000.0), ", of unknown accuracy$", True),
    ("EPSG:4258", (8.4, 49.0), "UTM zone 32N, exactly$", False),
])  # fmt: skip
def test_a_transformation_says_which_operation_it_took_and_how_exact_it_is(source, place, words, moves):
    transform = PointTransform(source, UTM)
    assert not np.isfinite(transform.apply(np.array([[np.inf, 0.0, 0.0]]))[0, 0])
    assert transform.operation is None
    transform.apply(np.array([[*place, 100.0]]))
    assert re.search(words, transform.words) and transform.operation.moves == moves


def test_a_map_that_would_be_off_by_more_than_a_voxel_is_refused_unless_asked(tmp_path, cloud_files, points):
    """With the least cell before all points are read; and it says what its coordinates are worth."""
    there = cloud_files.npz(tmp_path / "there.npz", _other(points, GAUSS_KRUEGER))
    for cell in (None, 0.5):
        options = MapOptions(crs=GAUSS_KRUEGER, to_crs=UTM, cell=cell)
        with pytest.raises(CrsError, match=r"of .*there\.npz exact to a voxel.*DHDN to ETRS89.*Get the grid, or"):
            build_map([there], tmp_path / "x.map", options)
    manifest = build_map([there], tmp_path / "a.map", replace(options, allow_inexact_crs=True))
    operation = manifest.build["sources"][0]["operation"]
    assert "DHDN to ETRS89" in operation["name"] and operation["accuracy"] > 0.5
    assert "warning: PROJ's operation may have put it off by " in inexact_words(manifest)
    unknown = Operation("Ballpark", -1.0, moves=False)
    with pytest.raises(CrsError, match=r"of unknown accuracy. Choose a CRS of the same datum, or take it"):
        unknown.check(1.0, "a.laz")
    unknown._replace(accuracy=0.5).check(0.5, "a.laz")


def test_a_part_of_a_cloud(tmp_path, cloud_files, points):
    path = cloud_files.las(tmp_path / "a.laz", points, crs=UTM)
    area = Area.parse("550010,5802005,550025,5802030")
    with open_cloud(path) as reader:
        seen = np.concatenate([chunk.points for chunk in reader.chunks()])
    inside = area.contains(seen)
    assert 200 < inside.sum() < 2000
    manifest = build_map([path], tmp_path / "part.map", MapOptions(area=area))
    assert manifest.n_points == inside.sum()
    assert manifest.build["sources"][0]["n_outside"] == (~inside).sum()
    build_map([cloud_files.npz(tmp_path / "inside.npz", seen[inside])], tmp_path / "inside.map", MapOptions(crs=UTM))
    assert _shared(_voxels(tmp_path / "part.map"), _voxels(tmp_path / "inside.map")) > 0.98  # LAS: on borders
    with pytest.raises(MapError, match="3,000 lie outside of the area"):
        build_map([path], tmp_path / "x.map", MapOptions(area=Area(0, 0, 1, 1)))
    for text in ("", "1,2,3", "1,2,3,x", "3,0,1,1", "0,0,0,1", "nan,0,1,1", "0,0,inf,1", "1,2,3,4,5"):
        with pytest.raises(OptionError, match="x_min,y_min,x_max,y_max"):
            Area.parse(text)


def test_real_copc_files_as_a_whole_and_by_area(real_data, tmp_path):
    folder = real_data("recorders/copc")
    lone_star = folder / "PDAL" / "lone-star.copc.laz"  # it says geocentric, and has coordinates of a UTM zone
    with pytest.raises(CrsError, match="--to-crs"):
        build_map([lone_star], tmp_path / "x.map", MapOptions(cell=0.5))
    with pytest.raises(CrsError, match=r"got 515378\.8, 4918365\.0, 2324\.3\. They are of another CRS"):
        build_map([lone_star], tmp_path / "x.map", MapOptions(cell=0.5, to_crs="EPSG:32613"))
    for path in (folder / "las-rs" / "autzen.copc.laz", folder / "laspy" / "simple_with_page.copc.laz"):  # in feet
        with pytest.raises(CrsError, match="foot"):
            build_map([path], tmp_path / "x.map")
        with open_cloud(path) as reader:
            crs, points = reader.header.crs, np.concatenate([chunk.points for chunk in reader.chunks()])
        placed = PointTransform(crs, "EPSG:32610").apply(points)
        np.testing.assert_allclose(np.ptp(placed[:, 2]), np.ptp(points[:, 2]) * 0.3048, rtol=1e-4)
        x, y = np.median(placed[:, :2], axis=0)
        area = Area(x - 5000.0, y - 200.0, x + 1.0, y + 200.0)
        options = MapOptions(to_crs="EPSG:32610", area=area, cell=1.0, drop=(), allow_inexact_crs=True)
        manifest = build_map([path], tmp_path / f"{path.name}.map", options)
        counts = manifest.build["sources"][0]
        assert manifest.n_points == counts["n_kept"] == area.contains(placed).sum()
        assert 0 < counts["n_outside"] == len(points) - counts["n_kept"]
        assert "foot" in crs and "heights times 0.3048" in counts["transform"]


@pytest.mark.parametrize("name", ["scalar_Classification", "label"])
def test_classes_of_a_ply_are_those_of_las_if_one_says_so(tmp_path, points, name):
    head = ["ply", "format ascii 1.0", "element vertex 3000", *(f"property double {axis}" for axis in "xyz")]
    classes = np.repeat([2, 5, 6], 1000)
    rows = [f"{x:.4f} {y:.4f} {z:.4f} {c}" for (x, y, z), c in zip(points.tolist(), classes, strict=True)]
    path = tmp_path / "a.ply"
    path.write_text("\n".join([*head, f"property float {name}", "end_header", *rows]) + "\n")
    assert build_map([path], tmp_path / "all.map").n_points == 3000
    manifest = build_map([path], tmp_path / "some.map", MapOptions(classes_are_asprs=True))
    assert manifest.n_points == 1000
    assert manifest.build["sources"][0]["n_dropped"] == {"2": 1000, "5": 1000}
