# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A study answers as its methods do, goes on where it stopped, and outlives bad epochs."""

from dataclasses import dataclass

import numpy as np
import pytest

from maxcon._system.atomic import locked
from maxcon.drive.localize import DriveOptions, localize_drive
from maxcon.errors import ArrayError, FileError, MapError, OptionError, TrajectoryError
from maxcon.estimate import Estimate, Status
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import distinctness, pose_error
from maxcon.lab.study import COLUMNS, Study, StudyMethod, choose_methods, run_study
from maxcon.lab.study.configuration import CONFIGURATION
from maxcon.lab.study.run import spread_epochs
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
    """A method that fails where x is positive, and elsewhere says that the prior is right."""

    words: str = "Expected nothing, got something. Leave it."

    def localize(self, scan, point_map, prior):
        if scan.time > 386_402.0:
            raise ArrayError(self.words)
        return Estimate(prior, 1.0, None, Status.LOCALIZED, np.eye(2))


def test_one_row_per_epoch_and_method(study, methods):
    keys = list(keys_of(study.table))
    assert len(keys) == len(set(keys)) == N_EPOCHS * len(methods)
    assert study.table.schema.names == list(COLUMNS)
    assert {row["method"] for row in study.table.to_pylist()} == {method.name for method in methods}
    assert not (study.folder / "parts").exists()
    assert Study.open(study.folder).table.equals(study.table)
    assert list(study.configuration.methods) == [method.name for method in methods]
    (run,) = study.configuration.runs
    assert (run["n_rows"], run["n_epochs"], run["priors"]) == (len(keys), N_EPOCHS, ["uniform"])


@pytest.mark.parametrize("name", ["count-points", "helmert-occupied", "icp-plane-1m"])
def test_rows_say_what_the_method_says(study, simulated, methods, name):
    (method,) = [method.method for method in methods if method.name == name]
    point_map = PointMap.open(study.folder / "maps" / "standard.map")
    reference = read_trajectory(simulated.reference)
    drive = localize_drive(point_map, open_scans(simulated.scans), read_trajectory(simulated.prior), method)
    for row, epoch in zip(rows_of(study, name), drive, strict=True):
        pose = point_map.frame.pose_to_global(epoch.estimate.pose)
        true = reference.at(epoch.raw.time)
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
        if name != "icp-plane-1m":
            prior = point_map.frame.pose_to_local(read_trajectory(simulated.prior).at(epoch.raw.time))
            accumulator = method.accumulate(epoch.scan, point_map, prior)
            measures = distinctness(accumulator, method.objective)
            assert row["kurtosis"] == measures.kurtosis
            assert row["peak_ratio"] == measures.peak_ratio
        else:
            assert row["kurtosis"] is None


def test_a_multi_start_succeeds_only_if_every_start_does(study):
    rows = rows_of(study, "icp-plane-1m-5x5")
    assert {row["n_starts"] for row in rows} == {25}
    for row in rows:
        assert 0 <= row["n_converged"] <= 25
        assert row["is_success"] == (row["n_converged"] == 25)


def test_the_number_of_processes_changes_nothing(study, simulated, methods, tmp_path):
    (tmp_path / "maps").symlink_to(study.folder / "maps")
    with pytest.raises(FileError, match="holds maps"):
        run_study(simulated, tmp_path, methods, n_workers=2)
    (tmp_path / "maps").unlink()
    again = run_study(simulated, tmp_path / "again", methods, n_workers=2)
    assert without_times(again.table) == without_times(study.table)


def test_what_is_done_is_not_done_again(simulated, copied, tmp_path, small_space):
    folder = tmp_path / "study"
    first = choose_methods(["helmert-occupied"], small_space)
    both = choose_methods(["helmert-occupied", "count-points"], small_space)
    begun = run_study(copied, folder, first, n_epochs=3, n_workers=1)
    assert [row["epoch"] for row in begun.table.to_pylist()] == spread_epochs(N_EPOCHS, 3) == [0, 2, 5]
    # A part that was written before a kill, with a row that is in the table too: the table's row counts.
    other = begun.table.slice(0, 1).set_column(table_schema().get_field_index("ms"), "ms", [[-1.0]])
    table_of(folder).add(other.to_pylist())
    more = run_study(copied, folder, both, n_workers=1)
    assert len(more.table) == len(set(keys_of(more.table))) == 2 * N_EPOCHS
    old = {row["epoch"]: row["ms"] for row in begun.table.to_pylist()}
    new = {row["epoch"]: row["ms"] for row in rows_of(more, "helmert-occupied")}
    assert {epoch: new[epoch] for epoch in old} == old
    assert [run["n_rows"] for run in more.configuration.runs] == [3, 2 * N_EPOCHS - 3]
    done = run_study(copied, folder, both, n_workers=1)
    assert done.table.equals(more.table)
    assert len(done.configuration.runs) == 2


def test_where_a_search_starts_is_told_apart(copied, tmp_path, small_space):
    """The same search from the prior and around the reference, in either order."""
    (known,) = choose_methods(["helmert-occupied"], small_space)
    pair = [StudyMethod("prior", known.method), StudyMethod("reference", known.method, around_reference=True)]
    tables = [run_study(copied, tmp_path / str(n), order, n_epochs=2, n_workers=1).table
              for n, order in enumerate((pair, pair[::-1]))]  # fmt: skip
    assert without_times(tables[0]) == without_times(tables[1])
    rows = {(row["method"], row["epoch"]): row for row in tables[0].to_pylist()}
    for (name, _), row in rows.items():
        centre = ("reference_x", "reference_y") if name == "reference" else None
        if centre:
            steps = [(row[axis] - row[of]) / small_space.cell_edge for axis, of in zip("xy", centre, strict=True)]
            assert steps == pytest.approx(np.round(steps), abs=1e-3)


def test_what_a_kill_leaves_half_written_is_cleared(copied, tmp_path, small_space):
    folder = tmp_path / "study"
    chosen = choose_methods(["helmert-occupied"], small_space)
    run_study(copied, folder, chosen, n_epochs=2, n_workers=1)
    (folder / "parts").mkdir()
    (folder / "parts" / ".abc.parquet.partial-12345678").mkdir()
    study = run_study(copied, folder, chosen, n_epochs=3, n_workers=1)
    assert len(study.table) == len({*spread_epochs(N_EPOCHS, 2), *spread_epochs(N_EPOCHS, 3)})
    assert not (folder / "parts").exists()
    assert [set(run) >= {"n_rows", "seconds"} for run in study.configuration.runs] == [True, True]


def test_a_study_stopped_while_maps_are_built_is_gone_on_with(simulated, study, tmp_path, small_space):
    folder, chosen = tmp_path / "study", choose_methods(["helmert-occupied"], small_space)

    def interrupt(step, done, total):
        if (folder / "maps").exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(simulated, folder, chosen, n_epochs=1, n_workers=1, progress=interrupt)
    assert (folder / "maps").exists()
    (folder / f".{CONFIGURATION}.partial-12345678").mkdir()
    run_study(simulated, folder, chosen, n_epochs=1, n_workers=1)
    assert sorted(path.name for path in folder.iterdir()) == [".lock", "maps", "study.json", "table.parquet"]
    assert len(run_study(simulated, folder, chosen, n_epochs=1, n_workers=1).table) == 1


def test_a_prior_that_was_refused_may_be_mended_for_the_same_study(copied, tmp_path, small_space):
    folder, chosen = tmp_path / "study", choose_methods(["helmert-occupied"], small_space)
    prior = copied.prior.read_text()
    copied.prior.write_text("".join(f"9{line}\n" for line in prior.splitlines() if line[0] != "#"))
    with pytest.raises(TrajectoryError, match="Expected poses"):
        run_study(copied, folder, chosen, n_epochs=1, n_workers=1)
    copied.prior.write_text(prior)
    assert len(run_study(copied, folder, chosen, n_epochs=1, n_workers=1).table) == 1


def test_two_processes_on_one_study_are_refused(copied, tmp_path, small_space):
    folder = tmp_path / "study"
    folder.mkdir()
    chosen = choose_methods(["helmert-occupied"], small_space)
    with locked(folder / ".lock", "it"), pytest.raises(FileError, match="another process is at work on it"):
        run_study(copied, folder, chosen, n_epochs=1, n_workers=1)
    assert len(run_study(copied, folder, chosen, n_epochs=1, n_workers=1).table) == 1


def test_priors_and_the_reference_are_told_apart(copied, tmp_path, small_space):
    (copied.folder / "second.txt").write_bytes(copied.reference.read_bytes())
    text = copied.path.read_text().replace("[priors]", '[priors]\nsecond = "second.txt"')
    copied.path.write_text(text)
    dataset = Dataset.open(copied.path)
    chosen = choose_methods(["helmert-occupied"], small_space)
    names = [*dataset.priors, "reference"]
    study = run_study(dataset, tmp_path / "study", chosen, priors=names, n_epochs=2, n_workers=1)
    offsets = {prior: [row["prior_distance"] for row in rows_of(study, "helmert-occupied", prior)] for prior in names}
    assert offsets["second"] == offsets["reference"] == [0.0, 0.0]
    assert min(offsets["uniform"]) > 0.05


def test_options_are_part_of_a_study(copied, tmp_path, small_space):
    folder = tmp_path / "study"
    chosen = choose_methods(["helmert-occupied"], small_space)
    near = run_study(copied, folder, chosen, n_epochs=1, n_workers=1, options=DriveOptions(max_range=20.0))
    assert near.configuration.options == {"min_range": 1.0, "max_range": 20.0, "max_gap": 0.5}
    assert near.configuration.maps["standard"] == {"path": str(copied.map_path)}
    with pytest.raises(OptionError, match="go on with the study with the options"):
        run_study(copied, folder, chosen, n_epochs=2, n_workers=1)


def test_another_clock_is_said_at_once(copied, tmp_path, small_space):
    lines = copied.reference.read_text().splitlines()
    moved = [line if line.startswith("#") else "9" + line for line in lines]
    copied.reference.write_text("\n".join(moved) + "\n")
    chosen = choose_methods(["helmert-occupied"], small_space)
    with pytest.raises(TrajectoryError, match="Expected poses of reference for the scans"):
        run_study(copied, tmp_path / "study", chosen, n_workers=1)


def test_without_a_reference_there_is_no_success(copied, tmp_path, small_space):
    lines = [line for line in copied.reference.read_text().splitlines() if not line.startswith("#")]
    copied.reference.write_text("\n".join(lines[:3]) + "\n")
    chosen = choose_methods(["helmert-occupied", "icp-plane-1m-5x5"], small_space)
    study = run_study(copied, tmp_path / "study", chosen, n_workers=1)
    rows = rows_of(study, "helmert-occupied")
    assert [row["is_success"] for row in rows[3:]] == [None] * 3
    assert all(row["x"] is not None and row["distance"] is None for row in rows[3:])
    rows = rows_of(study, "icp-plane-1m-5x5")
    assert {(row["status"], row["reason"]) for row in rows[3:]} == {("no prior", "no reference pose to start around")}


def test_an_objective_below_zero_is_no_failure(copied, tmp_path, small_space):
    mine = StudyMethod("mine", MaximumConsensus(small_space, Negative()))
    rows = rows_of(run_study(copied, tmp_path / "study", [mine], n_epochs=2, n_workers=1), "mine")
    assert all(row["x"] is not None and row["kurtosis"] is None for row in rows)


def test_bad_epochs_become_rows(copied, tmp_path, small_space):
    scans = sorted(copied.scans.glob("*.bin"))
    scans[1].write_bytes(scans[1].read_bytes()[:-5])
    scans[2].write_bytes(b"")
    np.zeros((10, 4), "<f4").tofile(scans[3])
    lines = copied.prior.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    words = lines[first].split()
    lines[first] = " ".join([words[0], str(float(words[1]) + 5000.0), *words[2:]])
    copied.prior.write_text("\n".join(lines[:-1]) + "\n")
    chosen = choose_methods(["helmert-points", "icp-plane-1m"], small_space)
    study = run_study(copied, tmp_path / "study", chosen, n_workers=1)
    for name in ("helmert-points", "icp-plane-1m"):
        rows = rows_of(study, name)
        statuses = ["outside the map", "unreadable scan", "unreadable scan", "no points", "localized", "no prior"]
        assert [row["status"] for row in rows] == statuses
        assert "truncated" in rows[1]["reason"]
        assert scans[2].name in rows[2]["reason"]
        assert rows[0]["prior_distance"] > 4000.0
        assert [row["is_success"] for row in rows] == [False, False, False, False, True, False]
        assert [row["x"] is None for row in rows] == [True, True, True, True, False, True]


def test_a_method_of_the_user_s_may_fail_as_it_likes(copied, tmp_path):
    study = run_study(copied, tmp_path / "study", [StudyMethod("mine", Careless())], n_epochs=2, n_workers=1)
    assert [(row["status"], row["reason"]) for row in rows_of(study, "mine")] == [
        ("failed", "AttributeError: 'Pose' object has no attribute 'status'")
    ] * 2


def test_parts_that_changed_are_refused_and_new_priors_are_not(copied, tmp_path, small_space):
    folder, chosen = tmp_path / "study", choose_methods(["helmert-occupied"], small_space)
    run_study(copied, folder, chosen, n_epochs=1, n_workers=1)
    (copied.folder / "second.txt").write_bytes(copied.prior.read_bytes())
    copied.path.write_text(copied.path.read_text() + '# a comment\nsecond = "second.txt"\n')
    more = run_study(Dataset.open(copied.path), folder, chosen, n_epochs=1, n_workers=1)
    assert {row["prior"] for row in more.table.to_pylist()} == {"uniform", "second"}
    copied.folder.rename(tmp_path / "moved")
    moved = Dataset.open(tmp_path / "moved")
    assert run_study(moved, folder, chosen, n_epochs=1, n_workers=1).table.equals(more.table)
    moved.prior.write_text(moved.prior.read_text().replace("\n", " \n", 1))
    with pytest.raises(OptionError, match="Expected the prior uniform of the dataset to be as before"):
        run_study(moved, folder, chosen, n_epochs=2, n_workers=1)


def test_another_crs_is_said_at_once(copied, tmp_path, small_space):
    lines = copied.reference.read_text().splitlines()
    poses = [line if line.startswith("#") else " ".join([line.split()[0], "9.0", *line.split()[2:]]) for line in lines]
    copied.reference.write_text("\n".join(poses) + "\n")
    chosen = choose_methods(["helmert-occupied"], small_space)
    with pytest.raises(MapError, match=r"Expected poses of reference inside the map.* in the same CRS"):
        run_study(copied, tmp_path / "study", chosen, n_workers=1)


def test_a_method_that_fails_is_a_row_with_its_reason(copied, tmp_path):
    study = run_study(copied, tmp_path / "study", [StudyMethod("mine", Contrary())], n_workers=1)
    rows = rows_of(study, "mine")
    failed = [row for row in rows if row["time"] > 386_402.0]
    assert 0 < len(failed) < N_EPOCHS
    assert {(row["status"], row["reason"], row["x"]) for row in failed} == {("failed", Contrary().words, None)}
    assert all(row["distance"] == pytest.approx(row["prior_distance"]) for row in rows if row not in failed)


def test_a_study_goes_on_only_with_the_same(study, simulated, copied, methods, tmp_path, small_space):
    with pytest.raises(OptionError, match="Expected the description of map and scans of the dataset to be as before"):
        run_study(copied, study.folder, methods)
    wider = choose_methods(["helmert-occupied"], type(small_space)(half_width=1.5))
    with pytest.raises(OptionError, match=r"as before in this study, with method\.space\.half_width 1\.2, got 1\.5; "):
        run_study(simulated, study.folder, wider)
    (tmp_path / "letters.txt").touch()
    with pytest.raises(FileError, match=r"holds .*dataset"):
        run_study(simulated, tmp_path, methods)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"priors": ["gnss"]}, "Expected a prior of uniform"),
        ({"n_epochs": 7}, "Expected 1 to 6 epochs"),
        ({"n_epochs": 0}, "Expected 1 to 6 epochs"),
    ],
)
def test_what_is_not_there_is_refused(simulated, methods, tmp_path, options, words):
    with pytest.raises(OptionError, match=words):
        run_study(simulated, tmp_path / "study", methods, **options)
    assert not (tmp_path / "study").exists()


def test_methods_need_names_of_their_own(simulated, methods, tmp_path):
    with pytest.raises(OptionError, match="name of its own"):
        run_study(simulated, tmp_path / "study", [*methods, methods[0]])
    with pytest.raises(OptionError, match="at least one method"):
        run_study(simulated, tmp_path / "study", [])


def test_a_built_map_has_no_variants(copied, tmp_path, small_space):
    with pytest.raises(OptionError, match=r"Expected clouds in .* to build the map 'cell-0\.03'"):
        run_study(copied, tmp_path / "study", choose_methods(["cells"], small_space))


def test_variants_are_maps_of_the_same_clouds(simulated, study, tmp_path, small_space):
    names = ["helmert-cell-0.12", "helmert-occupied-density-1/4", "helmert-ground", "helmert-occupied"]
    done = run_study(simulated, tmp_path / "study", choose_methods(names, small_space), n_epochs=2, n_workers=1)
    maps = {path.name: PointMap.open(path) for path in (tmp_path / "study" / "maps").iterdir()}
    assert set(maps) == {"cell-0.12.map", "density-1-4.map", "ground.map", "standard.map"}
    n_voxels = {name: len(point_map.all_voxels()[0]) for name, point_map in maps.items()}
    assert maps["cell-0.12.map"].cell == 0.12
    assert n_voxels["density-1-4.map"] < 0.6 * n_voxels["standard.map"] < n_voxels["ground.map"]
    assert {row["status"] for row in done.table.to_pylist()} <= {"localized", "ambiguous", "few matches"}


def test_a_broken_table_is_said(study, tmp_path, simulated):
    with pytest.raises(FileError, match="Expected a study in"):
        Study.open(tmp_path)
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(FileError, match="Expected a study in"):
        Study.open(tmp_path)
    (tmp_path / "study.json").write_bytes((study.folder / "study.json").read_bytes())
    (tmp_path / "table.parquet").write_bytes(b"PAR1 is not enough")
    with pytest.raises(FileError, match="Expected a part of a study's table in"):
        Study.open(tmp_path)


def test_datasets_open_by_file_too(simulated):
    assert Dataset.open(simulated.path) == simulated
