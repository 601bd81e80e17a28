"""A study answers as its methods do, goes on where it stopped, and outlives bad epochs."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from maxcon.drive.localize import DriveOptions, localize_drive
from maxcon.errors import ArrayError, FileError, MapError, OptionError, TrajectoryError
from maxcon.estimate import Estimate, Status
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.distinctness import distinctness
from maxcon.lab.evaluation import pose_error
from maxcon.lab.study import COLUMNS, Study, StudyMethod, choose_methods, run_study
from maxcon.lab.study.methods import make_maps
from maxcon.lab.study.run import CONFIGURATION, spread_epochs
from maxcon.lab.study.table import keys_of, table_of, table_schema
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.search.objectives import Helmert

N_EPOCHS = 6


def rows_of(study, method, prior="uniform"):
    rows = study.table.to_pylist()
    return [row for row in rows if (row["method"], row["prior"]) == (method, prior)]


def without_times(table):
    return table.drop_columns(["ms"]).to_pylist()


def rewrite(path, change):
    """Change each pose of a trajectory, a list of words; None leaves it out."""
    lines = path.read_text().splitlines()
    poses = [line if line.startswith("#") else change(line.split()) for line in lines]
    path.write_text("".join(f"{line if isinstance(line, str) else ' '.join(line)}\n" for line in poses if line))


@dataclass(frozen=True)
class Careless:
    """Returns a pose where an estimate is expected."""

    def localize(self, scan, point_map, prior):
        return prior


@dataclass(frozen=True)
class Negative:
    """Helmert's score, less a thousand."""

    def score(self, moments):
        return Helmert().score(moments) - 1000.0


@dataclass(frozen=True)
class Contrary:
    """A method that fails late in the drive, and before says that the prior is right."""

    words: str = "Expected nothing, got something. Leave it."

    def localize(self, scan, point_map, prior):
        if scan.time > 386_402.0:
            raise ArrayError(self.words)
        return Estimate(prior, 1.0, None, Status.LOCALIZED, np.eye(2))


def test_one_row_per_epoch_and_method(study, simulated, methods):
    keys = list(keys_of(study.table))
    assert len(keys) == len(set(keys)) == N_EPOCHS * len(methods)
    assert study.table.schema.names == list(COLUMNS) and not (study.folder / "parts").exists()
    assert list(study.configuration.methods) == [method.name for method in methods]
    (run,) = study.configuration.runs
    assert (run["n_rows"], run["n_epochs"], run["priors"]) == (len(keys), N_EPOCHS, ["uniform"])
    assert Dataset.open(simulated.path) == simulated
    rows = rows_of(study, "icp-plane-1m-5x5")
    assert {row["n_starts"] for row in rows} == {25}
    assert all(row["is_success"] == (row["n_converged"] == 25) for row in rows)


@pytest.mark.parametrize("name", ["count-points", "helmert-occupied", "icp-plane-1m"])
def test_rows_say_what_the_method_says(study, simulated, methods, name):
    (method,) = [method.method for method in methods if method.name == name]
    point_map = PointMap.open(study.folder / "maps" / "standard.map")
    reference, prior = read_trajectory(simulated.reference), read_trajectory(simulated.prior)
    drive = localize_drive(point_map, simulated.open_scans(), prior, method)
    for row, epoch in zip(rows_of(study, name), drive, strict=True):
        pose, true = point_map.frame.pose_to_global(epoch.estimate.pose), reference.at(epoch.raw.time)
        error = pose_error(pose, true)
        expected = {
            "epoch": epoch.epoch, "status": epoch.status.value, "x": pose.x, "y": pose.y, "z": pose.z,
            "heading": pose.heading, "reference_x": true.x, "reference_heading": true.heading,
            "distance": error.distance, "along": error.along, "across": error.across,
            "is_success": error.is_success, "score": epoch.estimate.score, "n_points": len(epoch.scan),
            "is_localized": epoch.estimate.is_localized,
        }  # fmt: skip
        for key, value in expected.items():
            assert row[key] == (pytest.approx(value, abs=1e-6) if isinstance(value, float) else value), key
        assert row["ms"] > 0.0
        measures = (None, None)
        if name != "icp-plane-1m":
            start = point_map.frame.pose_to_local(prior.at(epoch.raw.time))
            found = distinctness(method.accumulate(epoch.scan, point_map, start), method.objective)
            measures = (found.kurtosis, found.peak_ratio)
        assert (row["kurtosis"], row["peak_ratio"]) == measures


@pytest.mark.clusters
def test_the_number_of_processes_changes_nothing(study, simulated, methods, tmp_path):
    again = run_study(simulated, tmp_path / "again", methods, n_workers=2)
    assert without_times(again.table) == without_times(study.table)


def test_what_is_done_is_not_done_again(tried):
    begun = tried(n_epochs=3)
    assert [row["epoch"] for row in begun.table.to_pylist()] == spread_epochs(N_EPOCHS, 3) == [0, 2, 5]
    # Parts that a kill left behind: one whole, with a row that is in the table too (the table's counts), one not.
    other = begun.table.slice(0, 1).set_column(table_schema().get_field_index("ms"), "ms", [[-1.0]])
    parts = table_of(begun.folder)
    parts.add(other.to_pylist())
    (parts.parts / ".abc.parquet.partial-12345678").mkdir()
    both = ("helmert-occupied", "count-points")
    more = tried(both)
    assert len(more.table) == len(set(keys_of(more.table))) == 2 * N_EPOCHS
    assert not parts.parts.exists()
    old = {row["epoch"]: row["ms"] for row in begun.table.to_pylist()}
    new = {row["epoch"]: row["ms"] for row in rows_of(more, "helmert-occupied")}
    assert {epoch: new[epoch] for epoch in old} == old
    assert [run["n_rows"] for run in more.configuration.runs] == [3, 2 * N_EPOCHS - 3]
    done = tried(both)
    assert done.table.equals(more.table) and len(done.configuration.runs) == 2


def test_where_a_search_starts_and_which_prior_are_told_apart(copied, tried, tmp_path, small_space):
    (copied.folder / "second.txt").write_bytes(copied.reference.read_bytes())
    copied.path.write_text(copied.path.read_text().replace("[priors]", '[priors]\nsecond = "second.txt"'))
    (known,) = choose_methods(["helmert-occupied"], small_space)
    pair = [StudyMethod("prior", known.method), StudyMethod("around", known.method, around_reference=True)]
    dataset = Dataset.open(copied.path)
    names = ["uniform", "second", "reference"]
    study = tried(pair, dataset, priors=names, n_epochs=2)
    offsets = {name: [row["prior_distance"] for row in rows_of(study, "prior", name)] for name in names}
    assert offsets["second"] == offsets["reference"] == [0.0, 0.0]
    assert min(offsets["uniform"]) > 0.05
    for row in rows_of(study, "around"):
        steps = [(row[axis] - row[f"reference_{axis}"]) / small_space.cell_edge for axis in "xy"]
        assert steps == pytest.approx(np.round(steps), abs=1e-3)
    other = run_study(dataset, tmp_path / "other", pair[::-1], priors=["uniform"], n_epochs=2, n_workers=1)
    assert without_times(other.table) == [row for row in without_times(study.table) if row["prior"] == "uniform"]


def test_a_study_stopped_while_maps_are_built_is_gone_on_with(simulated, tried, tmp_path):
    folder = tmp_path / "study"

    def interrupt(step, done, total):
        if (folder / "maps").exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tried(dataset=simulated, n_epochs=1, progress=interrupt)
    assert (folder / "maps").exists()
    (folder / f".{CONFIGURATION}.partial-12345678").mkdir()
    assert len(tried(dataset=simulated, n_epochs=1).table) == 1
    assert sorted(path.name for path in folder.iterdir()) == ["maps", "study.json", "table.parquet"]


def test_another_clock_or_crs_is_said_at_once_and_may_be_mended(copied, tried):
    of_another_clock, in_another_crs = lambda pose: ["9" + pose[0], *pose[1:]], lambda pose: [pose[0], "9.0", *pose[2:]]
    for path, change, error, words in (
        (copied.prior, of_another_clock, TrajectoryError, "uniform for the scans"),
        (copied.reference, of_another_clock, TrajectoryError, "reference for the scans"),
        (copied.reference, in_another_crs, MapError, "reference inside the map.* in the same CRS"),
    ):
        right = path.read_text()
        rewrite(path, change)
        with pytest.raises(error, match=f"Expected poses of {words}"):
            tried(n_epochs=1)
        path.write_text(right)
    assert len(tried(n_epochs=1).table) == 1


def test_a_study_goes_on_only_with_the_same(copied, tried, study, methods, small_space, tmp_path):
    near = tried(n_epochs=1, options=DriveOptions(max_range=20.0))
    assert near.configuration.options == {"min_range": 1.0, "max_range": 20.0, "max_gap": 0.5}
    assert near.configuration.maps["standard"] == {"path": str(copied.map_path)}
    with pytest.raises(OptionError, match="go on with the study with the options"):
        tried(n_epochs=2)
    with pytest.raises(OptionError, match="Expected the description of map and scans of the dataset to be as before"):
        run_study(copied, study.folder, methods)
    wider = choose_methods(["helmert-occupied"], type(small_space)(half_width=1.5))
    with pytest.raises(OptionError, match=r"as before in this study, with method\.space\.half_width 1\.2, got 1\.5; "):
        tried(wider, options=DriveOptions(max_range=20.0))


def test_parts_that_changed_are_refused_and_new_priors_are_not(copied, tried, tmp_path):
    tried(n_epochs=1)
    (copied.folder / "second.txt").write_bytes(copied.prior.read_bytes())
    copied.path.write_text(copied.path.read_text() + '# a comment\nsecond = "second.txt"\n')
    more = tried(dataset=Dataset.open(copied.path), n_epochs=1)
    assert {row["prior"] for row in more.table.to_pylist()} == {"uniform", "second"}
    copied.folder.rename(tmp_path / "moved")
    moved = Dataset.open(tmp_path / "moved")
    assert tried(dataset=moved, n_epochs=1).table.equals(more.table)
    moved.prior.write_text(moved.prior.read_text().replace("\n", " \n", 1))
    with pytest.raises(OptionError, match="Expected the prior uniform of the dataset to be as before"):
        tried(dataset=moved, n_epochs=2)


def test_without_a_reference_there_is_no_success(copied, tried, methods):
    lines = [line for line in copied.reference.read_text().splitlines() if not line.startswith("#")]
    copied.reference.write_text("\n".join(lines[:1]) + "\n")
    study = tried(methods[2:], n_epochs=2)
    _, last = rows_of(study, "helmert-occupied")
    assert last["is_success"] is None and last["distance"] is None and last["x"] is not None
    _, last = rows_of(study, "icp-plane-1m-5x5")
    assert (last["status"], last["reason"]) == ("no prior", "no reference pose to start around")


def test_bad_epochs_become_rows(copied, tried):
    scans = sorted(copied.scans.glob("*.bin"))
    scans[1].write_bytes(scans[1].read_bytes()[:-5])
    scans[2].write_bytes(b"")
    np.zeros((10, 4), "<f4").tofile(scans[3])
    times = iter(range(N_EPOCHS))
    moves = {0: lambda pose: [pose[0], str(float(pose[1]) + 5000.0), *pose[2:]], N_EPOCHS - 1: lambda pose: None}
    rewrite(copied.prior, lambda pose: moves.get(next(times), list)(pose))
    study = tried(("helmert-points", "icp-plane-1m"))
    for name in ("helmert-points", "icp-plane-1m"):
        rows = rows_of(study, name)
        statuses = ["outside the map", "unreadable scan", "unreadable scan", "no points", "localized", "no prior"]
        assert [row["status"] for row in rows] == statuses
        assert "truncated" in rows[1]["reason"] and scans[2].name in rows[2]["reason"]
        assert rows[0]["prior_distance"] > 4000.0
        assert [r["is_success"] for r in rows] == [r["x"] is not None for r in rows] == [False] * 4 + [True, False]


def test_methods_that_fail_are_rows_with_their_reason(tried, small_space):
    negative = StudyMethod("negative", MaximumConsensus(small_space, Negative()))
    study = tried([StudyMethod("careless", Careless()), StudyMethod("contrary", Contrary()), negative])
    reasons = {(row["status"], row["reason"]) for row in rows_of(study, "careless")}
    assert reasons == {("failed", "AttributeError: 'Pose' object has no attribute 'status'")}
    rows = rows_of(study, "contrary")
    failed = [row for row in rows if row["time"] > 386_402.0]
    assert 0 < len(failed) < N_EPOCHS
    assert {(row["status"], row["reason"], row["x"]) for row in failed} == {("failed", Contrary().words, None)}
    assert all(row["distance"] == pytest.approx(row["prior_distance"]) for row in rows if row not in failed)
    assert all(row["x"] is not None and row["kurtosis"] is None for row in rows_of(study, "negative"))


@pytest.mark.parametrize(("chosen", "options", "words"), [
    (slice(1), {"priors": ["gnss"]}, "Expected a prior of uniform"),
    (slice(1), {"n_epochs": 7}, "Expected 1 to 6 epochs"),
    (slice(1), {"n_epochs": 0}, "Expected 1 to 6 epochs"),
    (slice(0), {}, "at least one method"),
    ([0, 0], {}, "name of its own"),
])  # fmt: skip
def test_what_is_not_there_is_refused(simulated, methods, tmp_path, chosen, options, words):
    some = methods[chosen] if isinstance(chosen, slice) else [methods[number] for number in chosen]
    with pytest.raises(OptionError, match=words):
        run_study(simulated, tmp_path / "study", some, **options)
    assert not (tmp_path / "study").exists()


def test_variants_are_maps_of_the_same_clouds(simulated, copied, tried, tmp_path):
    tile = replace(simulated, map_clouds=simulated.map_clouds[:1])
    maps = make_maps(tile, tmp_path, ["standard", "cell-0.12", "density-1/4", "ground"])
    assert [path.name for path in maps.values()] == ["standard.map", "cell-0.12.map", "density-1-4.map", "ground.map"]
    opened = {name: PointMap.open(path) for name, path in maps.items()}
    n_voxels = {name: len(point_map.all_voxels()[0]) for name, point_map in opened.items()}
    assert opened["cell-0.12"].cell == 0.12
    assert n_voxels["density-1/4"] < 0.7 * n_voxels["standard"] < n_voxels["ground"]
    with pytest.raises(OptionError, match=r"Expected clouds in .* to build the map 'cell-0\.03'"):
        tried(["cells"])


def test_a_broken_study_is_said(tmp_path):
    for text in (None, "["):
        if text is not None:
            (tmp_path / "study.json").write_text(text)
        with pytest.raises(FileError, match="Expected a study in"):
            Study.open(tmp_path)
