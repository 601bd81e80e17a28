"""Clouds in, clouds out: a corner of two walls and a floor, in three passes and two tiles."""

import csv
import json
import re
import shutil

import laspy
import numpy as np
import pytest
from displaced_planes import CORNER, ORIGIN, moved, points_on

from maxcon.errors import CrsError, FileError, MapError, OptionError
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.mapping.align import AlignmentOptions, align_files
from maxcon.mapping.build.point_statistics import UNKNOWN_SIGMA, aligned_sigma
from maxcon.scan.trajectory import Trajectory
from written_maps import run

COMMAND = ("map", "align")
PRIOR = {"georeference_sigma": 0.1, "georeference_sigma_deg": 0.2}


def coordinates(path):
    las = laspy.read(path)
    return np.column_stack([las.x, las.y, las.z]) - ORIGIN, np.array(las.gps_time)


@pytest.fixture(scope="module")
def aligned(three_passes, tmp_path_factory):
    clouds, _twists = three_passes
    folder = tmp_path_factory.mktemp("aligned")
    trajectory = folder / "vehicle.txt"
    times = np.concatenate([300_000.0 + 100.0 * i + np.arange(0.0, 8.0, 0.5) for i in range(3)])
    positions = np.column_stack([np.tile(np.arange(0.0, 8.0, 0.5), 3), np.zeros(len(times)), np.full(len(times), 2.0)])
    write_tum(trajectory, Trajectory(times, positions + ORIGIN, np.tile([0, 0, 0, 1.0], (len(times), 1))))
    found = align_files(clouds, folder / "out", AlignmentOptions(**PRIOR), trajectories=[trajectory], n_threads=1)
    return found, folder / "out", trajectory


def test_passes_come_together(three_passes, aligned):
    found, _out, _ = aligned
    assert found.adjusted.drift_sigma == 0.0 and found.sigma_before > 0.03
    assert found.sigma_of_pass < 0.002
    assert found.sigma_of_map == pytest.approx(found.sigma_of_pass / np.sqrt(3))
    assert 0.05 < found.sigma_of_datum < 0.075
    _, twists = three_passes
    corners = ORIGIN + [[-9.0, 5.0, 1.0], [6.0, 5.0, 3.0], [6.0, -9.0, 1.0]]
    ends = []
    for number, twist in enumerate(twists):
        displaced = moved(corners - ORIGIN, twist) + ORIGIN
        times = np.full(3, 300_004.0 + 100.0 * number)
        ends.append(found.adjusted.corrections.moved(displaced, times, np.full(3, number)))
    ends = np.array(ends)
    assert np.linalg.norm(ends - ends.mean(axis=0), axis=2).max() < 0.004
    # where all are is the mean of where they were
    assert np.linalg.norm((ends.mean(axis=0) - corners).mean(axis=0)) < 3.0 * found.sigma_of_datum


def test_only_coordinates_change(three_passes, aligned):
    found, out, _ = aligned
    for source in three_passes[0]:
        before, after = laspy.read(source), laspy.read(out / f"{source.stem}.laz")
        assert len(before.points) == len(after.points)
        for name in before.point_format.dimension_names:
            if name not in ("X", "Y", "Z"):
                np.testing.assert_array_equal(before[name], after[name], err_msg=name)
        assert after.header.parse_crs() == before.header.parse_crs()
        np.testing.assert_array_equal(before.header.scales, after.header.scales)
        points, times = coordinates(source)
        passes = found.passes.at(times)
        wanted = found.adjusted.corrections.moved(points + ORIGIN, times, passes) - ORIGIN
        np.testing.assert_allclose(coordinates(out / f"{source.stem}.laz")[0], wanted, atol=0.00051)


def test_the_trajectory_moves_with_its_points_and_tables_say_what_was_found(aligned):
    found, out, trajectory = aligned
    before, after = read_trajectory(trajectory), read_trajectory(out / "vehicle.txt")
    passes, corrections = found.passes.at(before.times), found.adjusted.corrections
    np.testing.assert_allclose(after.positions, corrections.moved(before.positions, before.times, passes), atol=1e-6)
    turns = corrections.motions(before.times, passes)[2]
    np.testing.assert_allclose(after.angles, turns, atol=1e-5)  # from level, small turns are angles
    summary = json.loads((out / "alignment.json").read_text())
    assert summary["n_ties"] == len(found.constraints)
    assert summary["sigma"]["of_map"] == pytest.approx(found.sigma_of_map, abs=1e-5)
    assert aligned_sigma([out / "a.laz"]) == UNKNOWN_SIGMA  # of few matches; `map build` reads what was written
    assert summary["words"] == []
    rows = {name: list(csv.DictReader((out / f"{name}.csv").open())) for name in ("passes", "residuals", "ties")}
    assert [row["name"] for row in rows["passes"]] == ["pass 1", "pass 2", "pass 3"]
    assert [(row["pass_a"], row["pass_b"]) for row in rows["residuals"]] == [("1", "2"), ("1", "3"), ("2", "3")]
    for row in rows["residuals"]:
        assert float(row["horizontal_after_median"]) < 0.1 * float(row["horizontal_before_median"])
    assert len(rows["ties"]) == len(found.constraints)
    assert len(list(csv.DictReader((out / "corrections.csv").open()))) == len(corrections.knots)


def test_threads_change_nothing(three_passes, aligned, tmp_path):
    _, out, trajectory = aligned
    align_files(three_passes[0], tmp_path / "out", AlignmentOptions(**PRIOR), trajectories=[trajectory], n_threads=3)
    for file in (tmp_path / "out").iterdir():
        assert file.read_bytes() == (out / file.name).read_bytes(), file.name


def test_only_the_files_of_an_alignment_are_replaced(three_passes, aligned, tmp_path):
    """It lists them itself: other clouds and tables that were put beside them stay."""
    clouds, _ = three_passes
    _, made, trajectory = aligned
    out = tmp_path / "out"
    shutil.copytree(made, out)
    with pytest.raises(FileError, match="not to exist yet"):
        align_files(clouds, out)
    with pytest.raises(FileError, match="without what is to be aligned"):
        align_files(clouds, clouds[0].parent, overwrite=True)
    align_files(clouds, out, AlignmentOptions(**PRIOR), overwrite=True)
    names = {path.name for path in out.iterdir()}
    assert names == {path.name for path in made.iterdir()} - {trajectory.name}
    for name in ("mine.laz", "mine.csv", "mine.txt", "[we]st.laz"):
        (out / name).touch()
        with pytest.raises(FileError, match=rf"to be an alignment, .* it holds {re.escape(name)}"):
            align_files(clouds, out, overwrite=True)
        (out / name).unlink()
    for summary in ('{"files": ["*"]}', '{"files": 3}', "[]", "{"):
        (out / "alignment.json").write_text(summary)
        with pytest.raises(FileError, match=r"to be an alignment, .* it holds \w+\.laz"):
            align_files(clouds, out, overwrite=True)


def test_what_cannot_be_matched_is_told(tmp_path, write_las):
    here, there = (points_on(CORNER, 60, 0.01, np.random.default_rng(0)) for _ in range(2))
    times = np.linspace(0.0, 8.0, len(here))
    one = write_las(tmp_path / "a.laz", here, times)
    other = write_las(tmp_path / "b.laz", there + [500.0, 0.0, 0.0], times + 100.0)
    for clouds, words in (([one], "one pass only"), ([one, other], "no place that two of them saw enough of")):
        with pytest.raises(MapError, match=words):
            align_files(clouds, tmp_path / "out")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.laz", "b.laz"]


def test_a_pass_elsewhere_stays_and_is_told(tmp_path, write_las):
    rng = np.random.default_rng(0)
    passes = [points_on(CORNER, 60, 0.01, rng) for _ in range(3)]
    times = np.linspace(0.0, 8.0, len(passes[0]))
    passes[1] += [0.08, 0.03, 0.0]
    passes[2] += [500.0, 0.0, 0.0]
    clouds = [
        write_las(tmp_path / f"{i}.laz", points, times + 100.0 * i, point_format=1, version="1.2")
        for i, points in enumerate(passes)
    ]
    found = align_files(clouds, tmp_path / "out", AlignmentOptions(passes_by="file", **PRIOR))
    assert [each.component for each in found.connectivity] == [0, 0, 1]
    assert "cannot be connected" in found.connectivity[2].words
    np.testing.assert_allclose(coordinates(tmp_path / "out/2.laz")[0], coordinates(clouds[2])[0], atol=1e-6)
    gap = coordinates(tmp_path / "out/1.laz")[0].mean(axis=0) - coordinates(tmp_path / "out/0.laz")[0].mean(axis=0)
    was = coordinates(clouds[1])[0].mean(axis=0) - coordinates(clouds[0])[0].mean(axis=0)
    note = run(*COMMAND, *clouds, "-o", tmp_path / "again", "--passes", "file").splitlines()[-1]
    assert note.startswith("note         2.laz (") or note.startswith("note         pass 3 (")
    assert note.endswith("cannot be connected to any other: it stays where it was")
    np.testing.assert_allclose(gap - was, [-0.08, -0.03, 0.0], atol=0.006)


def test_what_cannot_be_is_refused(three_passes, tmp_path, write_las):
    clouds, _ = three_passes
    for wrong in ({"pause": 0.0}, {"georeference_sigma": -1.0}, {"drift_sigma": np.nan}, {"knot_spacing": 0.1}):
        with pytest.raises(OptionError):
            AlignmentOptions(**wrong)
    with pytest.raises(CrsError):
        align_files(clouds, tmp_path / "out", AlignmentOptions(crs="EPSG:32632"))
    (tmp_path / "sub").mkdir()
    twin = write_las(tmp_path / "sub" / "west.las", np.zeros((5, 3)), np.arange(5.0))
    with pytest.raises(FileError, match=r"west\.laz twice"):
        align_files([clouds[0], twin], tmp_path / "out")


def test_passes_at_the_same_time_have_no_trajectory(tmp_path, write_las):
    points = [points_on(CORNER, 40, 0.01, np.random.default_rng(seed)) for seed in range(2)]
    clouds = [write_las(tmp_path / f"{i}.laz", each, np.linspace(0.0, 8.0, len(each))) for i, each in enumerate(points)]
    trajectory = tmp_path / "t.txt"
    trajectory.write_text("0 0 0 0 0 0 0 1\n8 0 0 0 0 0 0 1\n")
    with pytest.raises(OptionError, match="at the same time"):
        align_files(clouds, tmp_path / "out", AlignmentOptions(passes_by="file"), trajectories=[trajectory])


def test_it_says_how_far_passes_lay_apart_and_what_that_makes_of_a_map(three_passes, tmp_path):
    clouds, _ = three_passes
    lines = run(*COMMAND, *clouds, "-o", tmp_path / "out", "--georeference-sigma-deg", "0.2").splitlines()
    assert lines[0] == str(tmp_path / "out") and lines[1] == "passes       3, told apart by time"
    assert lines[3] == "corrections  a motion of each pass, rigid"
    assert [line[:5] for line in lines[5:8]] == ["1 - 2", "1 - 3", "2 - 3"]
    assert lines[8].startswith("sigma        one pass beside the others 0.")
    assert "the mean of the passes' georeference" in lines[9]
    assert not any(line.startswith("note") for line in lines)
