"""`maxcon localize`: its options, windows from the certainty of priors, drives localized in part, and as a track."""

import inspect
import json
import math
import re
import shutil

import numpy as np
import pytest

import maxcon as library
from drawn_figures import undrawn
from localized_poses import localized_poses, rows_of
from maxcon import Trajectory
from maxcon.cli.drive_output import parse_epochs
from maxcon.cli.localize import localize as command
from maxcon.cli.options import LARGEST_HALF_WIDTH, SIGMAS
from maxcon.drive.hypotheses import WithinSigmas
from maxcon.errors import OptionError
from maxcon.io.trajectories import read_trajectory, write_csv, write_tum
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import simulate
from maxcon.lab.simulation.scanners import ProfileScanner

POSE = ("x", "y", "z", "roll", "pitch", "heading")


@pytest.fixture
def assert_close(drive, tmp_path):
    """Check that every epoch is localized near its reference."""

    def check(name="poses.csv", within=0.2):
        found = localized_poses(tmp_path / name)
        np.testing.assert_allclose(found[:, 0], drive.reference.times, atol=1e-6)
        assert np.abs(found[:, 1:3] - drive.reference.positions[:, :2]).max() < within

    return check


# --- options of the search ---
@pytest.mark.parametrize("options", [
    "--objective max-eigenvalue --threads 2",
    "--half-width 2.7 --heading-half-width-deg 3 --heading-step-deg 1 --min-range 3 --max-range 60",
    "--half-width 0.12",  # too small: searched wider
    "--height-half-width 0.6 --weighting one --thinning 0.5 --no-refinement",
])  # fmt: skip
def test_options_of_the_search(localize, assert_close, options):
    ended = localize(*options.split())
    assert (ended.code, ended.err) == (0, ""), ended
    assert ("were in doubt and searched for farther around" in ended.out) == ("0.12" in options)
    assert_close()


def test_answers_do_not_depend_on_threads_nor_on_the_search(localize, poses, tmp_path):
    localize("--threads", "2")
    assert rows_of(tmp_path / "poses.csv") == rows_of(poses)
    count = "--objective count --multiplicity points --half-width 1.2 --heading-half-width-deg 2 --cell 0.06 --wider 0"
    for search in ("exhaustive", "branch-and-bound"):
        assert localize(*count.split(), "--search", search, out=f"{search}.csv").code in (0, 1)
    rows = rows_of(tmp_path / "exhaustive.csv")
    assert rows == rows_of(tmp_path / "branch-and-bound.csv")
    assert all(float(row["score"]) == int(float(row["score"])) > 500 for row in rows)


OWN = """
class Fewest:
    def score(self, moments):
        return moments[..., 0] + 0.0

half = Fewest()
"""


def test_an_own_objective_scores(localize, tmp_path, monkeypatch):
    (tmp_path / "own.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    scores = []
    for objective in ("own:Fewest", "own:half", "count"):
        assert localize("--objective", objective, "--overwrite").code == 0
        scores.append([row["score"] for row in rows_of(tmp_path / "poses.csv")])
    assert scores[0] == scores[1] == scores[2]


def test_what_is_not_given_is_what_the_method_takes():
    given = {name: parameter.default for name, parameter in inspect.signature(command).parameters.items()}
    method, trust = library.MaximumConsensus(), library.Trust()
    for name in ("thinning", "weighting", "multiplicity", "search"):
        assert given[name] == getattr(method, name)
    assert given["objective"] == method.objective.name
    prior = library.Trajectory.from_poses([0.0], [library.Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)])
    within = WithinSigmas(method, prior)
    assert (within.sigmas, within.largest_half_width) == (SIGMAS, LARGEST_HALF_WIDTH)
    assert (given["least_share"], given["largest_runner_up"]) == (trust.least_share, trust.largest_runner_up)


# --- windows from standard deviations ---
def test_half_widths_by_standard_deviations(localize, tmp_path):
    given = "--sigma-position 1 --sigma-heading-deg 0.7 --sigmas 2 --heading-step-deg 0.75"
    same = "--half-width 2.04 --heading-half-width-deg 1.5 --heading-step-deg 0.75"
    for options, name in ((given, "given.csv"), (same, "same.csv")):
        ended = localize(*options.split(), "--wider", "0", out=name)
        assert ended.code in (0, 1) and ended.err == ""
    assert rows_of(tmp_path / "given.csv") == rows_of(tmp_path / "same.csv")


@pytest.fixture
def known_prior(drive, tmp_path):
    """Write the drive's prior as CSV, with a standard deviation of each position, m, and of headings, degrees."""

    def write(sigmas, sigma_heading_deg=0.7, shift=0.0):
        prior = read_trajectory(drive.dataset.prior)
        turn = math.radians(sigma_heading_deg)
        covariances = [np.diag([sigma**2, 0.5 * sigma**2, turn**2]) for sigma in sigmas]
        known = library.Trajectory(
            prior.times, prior.positions + [shift, 0.0, 0.0], prior.quaternions_xyzw, np.array(covariances)
        )
        write_csv(tmp_path / "known.csv", known)
        return tmp_path / "known.csv"

    return write


def test_windows_are_those_of_the_priors_covariances(localize, known_prior, tmp_path):
    prior, pictures = known_prior([0.5, 1.0, 1.0, 1.2]), tmp_path / "pictures"
    ended = localize("--plot", pictures, "--plot-epochs", "0", prior=prior)
    assert (ended.code, ended.err) == (0, ""), ended
    assert "\nwindows from the prior's covariances: half width 1.5 to 3.6 m, 2.1 degrees\n" in ended.out
    assert [(path.name, path.stat().st_size > 20_000) for path in pictures.iterdir()] == [("000000.png", True)]
    ended = localize("--sigmas", "2", "--largest-half-width", "2.2", "--overwrite", prior=prior)
    assert "half width 1.0 to 2.2 m, 1.4 degrees; 1 of them cut at 2.2 m\n" in ended.out


def test_windows_from_sigmas_that_are_too_small_grow(localize, known_prior, assert_close):
    ended = localize(prior=known_prior([0.01] * 4, 0.01, shift=6.0))
    assert (ended.code, ended.err) == (0, ""), ended
    assert "half width 1.0 m, 1.0 degrees\neach covariance contains 0.02 m that are only assumed" in ended.out
    assert "\n4 were in doubt and searched for farther around: epochs 0, 1, 2, 3\n" in ended.out
    assert "are its sigmas too small?" in ended.out
    assert_close()


@pytest.mark.parametrize(("options", "words"), [
    ("--half-width 3", "the prior's covariances are not used: --half-width"),
    ("--track", "the prior's covariances are not used: --track"),
    ("--sigma-position 1 --sigma-heading-deg 0.7", "windows from --sigma-position: half width 3.0 m, 2.1 degrees"),
])  # fmt: skip
def test_what_is_given_is_used_instead_of_the_priors_covariances(localize, known_prior, options, words):
    assert f"{words}\n" in localize(*options.split(), prior=known_prior([1.0] * 4)).out


def test_poses_with_covariances_are_a_prior_and_times_come_from_a_file(localize, drive, poses, assert_close, tmp_path):
    shutil.copy(drive.dataset.scans / "times.txt", tmp_path / "clock.txt")
    ended = localize("--times", tmp_path / "clock.txt", prior=poses)
    assert (ended.code, ended.err) == (0, ""), ended
    assert "windows from the prior's covariances: half width 1.0 m, 1.0 degrees" in ended.out
    assert_close()


# --- epochs without an answer ---
def write_rows(path, rows):
    path.write_text("".join(" ".join(row) + "\n" for row in rows))
    return path


def test_epochs_without_an_answer_are_rows_with_their_status(localize, drive, prior_rows, tmp_path):
    scans = shutil.copytree(drive.dataset.scans, tmp_path / "scans")
    content = (scans / "000003.bin").read_bytes()
    (scans / "000003.bin").write_bytes(content[: int(0.5001 * len(content))])
    prior_rows[2][1] = str(float(prior_rows[2][1]) + 10_000.0)
    del prior_rows[1]
    prior = write_rows(tmp_path / "prior.txt", prior_rows)
    ended = localize("--tum", tmp_path / "found.tum", prior=prior, scans=scans)
    assert (ended.code, ended.err) == (1, "")
    assert ended.out.startswith("1 of 4 epochs localized, median ")
    assert "\n1 no prior: The prior trajectory has no pose" in ended.out
    assert "\n1 outside the map: The prior lies outside the map.\n" in ended.out
    assert "\n1 unreadable scan" in ended.out and "epoch 1: " in ended.out
    rows = rows_of(tmp_path / "poses.csv")
    assert [row["status"] for row in rows] == ["localized", "no prior", "outside the map", "unreadable scan"]
    assert f"{scans / '000003.bin'}" in rows[3]["reason"] and "truncated" in rows[3]["reason"]
    for row in rows:
        assert {row[name] == "" for name in POSE} == {row["status"] != "localized"}
        assert row["time"] != ""
    for found in (tmp_path / "poses.csv", tmp_path / "found.tum"):
        np.testing.assert_allclose(read_trajectory(found).times, drive.reference.times[:1], atol=1e-6)


@pytest.mark.parametrize("kinds", [["zero", "1e9"], ["words", "cut"]])
def test_senseless_rows_are_rows_with_their_status(localize, prior_rows, tmp_path, kinds):
    for number, kind in enumerate(kinds, 1):
        row = prior_rows[number]
        prior_rows[number] = {
            "zero": [*row[:4], *"0000"], "words": ["lost"] * 8, "cut": row[:3], "1e9": [*row[:3], "1e9", *row[4:]],
        }[kind]  # fmt: skip
    prior, n_left_out = write_rows(tmp_path / "prior.txt", prior_rows), 2 - ("1e9" in kinds)
    ended = localize(prior=prior)
    assert (ended.code, ended.err) == (1, ""), ended
    assert f"{n_left_out} rows of the prior are left out; the first: {prior}, line 2: Expected" in ended.out
    rows = rows_of(tmp_path / "poses.csv")
    assert [row["status"] == "localized" for row in rows] == [True, False, False, True]
    assert all(row["reason"] != "" for row in rows[1:3])
    again = localize("--resume", prior=prior)
    assert (again.code, again.err) == (1, "") and "all 4 epochs were in" in again.out


@pytest.mark.parametrize(("options", "words"), [
    ("--min-range 119.99", r"\nleft out: .* out of range\n4 no points: The scan has no point within the range"),
    ("--half-width 0.12 --heading-half-width-deg 0 --wider 0", "are searched|(at the|few|undetermined|ambiguous)"),
])  # fmt: skip
def test_no_epoch_localized_writes_a_table_and_no_trajectory(localize, tmp_path, options, words):
    ended = localize(*options.split(), "--tum", tmp_path / "found.tum")
    assert (ended.code, ended.err) == (1, "")
    assert ended.out.startswith("0 of 4 epochs localized") and re.search(words, ended.out)
    assert len(rows_of(tmp_path / "poses.csv")) == 4
    assert not (tmp_path / "found.tum").exists() and "found.tum is not written\n" in ended.out


# --- pictures ---
def test_lists_of_epochs():
    for text, n, wanted in (("0,2", 3, {0, 2}), (" 1 , 0-1", 3, {0, 1}), ("ALL", 2, {0, 1}), ("3-5,4", 6, {3, 4, 5})):
        assert parse_epochs(text, n) == wanted
    assert (parse_epochs(None, 3), parse_epochs(None, 41)) == ({0, 1, 2}, set(range(0, 41, 5)))


@pytest.mark.parametrize("text", ["", ",", "-1", "1-", "2-1", "0-9", "1.5", "²", "9" * 5000, "0-1-2"])
def test_lists_of_epochs_that_are_none(text):
    with pytest.raises(OptionError, match=r"--plot-epochs to list epochs from 0 to 3, such as 0,5,10-20, or all"):
        parse_epochs(text, 4)


def test_a_page_of_the_drive_is_written_with_and_without_a_reference(localize, drive, refused, tmp_path, monkeypatch):
    page = tmp_path / "page.html"
    ended = localize("--report", page, "--reference", drive.dataset.reference, "-q")
    assert (ended.code, ended.err) == (0, "") and ended.out.endswith(f"a page of it: {page}\n")
    text = page.read_text(encoding="utf-8")
    assert "4 of 4 scans are localized" in text and "How far from the reference" in text
    assert f"<dd>{drive.dataset.reference}</dd>" in text
    assert "12 m and 10 degrees around" in text and "assumed: " in text and "(EPSG:25832)" in text
    refused(localize("--report", tmp_path / "page.pdf", out="b.csv"), "a page .html or .htm as --report", "Rename it")
    undrawn(monkeypatch)
    assert localize("--report", page, "--resume", "-q").code == 0
    assert "--reference POSES" in page.read_text(encoding="utf-8")
    refused(localize("--report", tmp_path / "b.csv", out="b.csv"), "--report, got one twice")
    alone = localize("--reference", drive.dataset.reference, "-q", out="b.csv").out
    assert alone.partition("\n")[2] in ended.out
    assert re.search(r"reference: 4 localized scans, 0 .*\n  along    median 0.0.*; within 1, 2, 3 sigma", alone)


def test_one_scan_by_a_place_in_the_map_and_a_heading_in_place_of_a_prior(localize, drive, refused, tmp_path):
    scan, true = drive.dataset.scans / "000000.bin", drive.reference.pose(0)
    at = f"{true.x + 1.0},{true.y - 1.0},{math.degrees(true.heading):.0f}"
    assert localize("--at", at, prior=None, scans=scan).code == 0
    (found,) = rows_of(tmp_path / "poses.csv")
    assert math.hypot(float(found["x"]) - true.x, float(found["y"]) - true.y) < 0.2
    assert abs(float(found["z"]) - true.z) < 0.2
    refused(localize("--at", "-1,-2,-90", prior=None, scans=scan, out="b.csv"), "ground", "-1,-2,-90", "CRS")
    refused(localize("--at", "1,2,3", out="b.csv"), "either --at or --prior")


@pytest.mark.parametrize(("options", "words"), [
    ("--at 1,2", ("Expected --at X,Y,HEADING_DEG,", "'1,2'", "--at 549980,5801820,90")),
    ("--at 1,2,north", ("--at X,Y,HEADING_DEG",)),
    ("--at 1,2,3", ("one scan with --at, got 4",)),
    ("--at 1,2,3 --geoid-height 40", ("either --at or --geoid-height",)),
])  # fmt: skip
def test_a_place_is_three_numbers_and_of_one_scan(localize, refused, options, words):
    refused(localize(*options.split(), prior=None), *words)


def test_the_summary_as_json_has_the_facts_of_the_sentences(localize, drive, tmp_path):
    named = ("--reference", drive.dataset.reference, "--tum", tmp_path / "poses.tum")
    told = json.loads(localize(*named, "--json").out)
    assert (told["epochs"], told["localized"], told["not_localized"], told["widened"]) == (4, 4, {}, [])
    assert told["median_ms"] > 0.0
    assert (told["poses"], told["tum"]) == (str(tmp_path / "poses.csv"), str(tmp_path / "poses.tum"))
    assert told["points_left_out"]["out_of_range"] >= 0
    (along, *_) = told["accuracy"]["rows"]
    assert along["name"] == "along" and along["of"]["median"] < 0.1 and len(along["within"]) == 3
    ended = localize("--json", "--half-width", "0.12", "--wider", "0", out="b.csv")
    told = json.loads(ended.out)
    statuses = told["not_localized"]
    assert ended.code == 1 and sum(each["epochs"] for each in statuses.values()) == 4 - told["localized"] > 0
    assert all(each["explanation"].endswith(".") for each in statuses.values())
    assert told["alternative"] is not None


@pytest.fixture(scope="module")
def dense(built_once):
    """Twelve epochs through the city of the small drive, whose map is there already."""
    thinnest = (ProfileScanner(line_rate=2.0, points_per_line=30),)

    def make(folder):
        simulate(folder / "dataset", n_epochs=12, seed=3, before=30.0, after=20.0, mapping_scanners=thinnest)

    return Dataset.open(built_once("dense", make) / "dataset")


@pytest.fixture
def odometry(dense, tmp_path):
    """The reference from a frame of its own."""
    reference = read_trajectory(dense.reference)
    poses = [reference.pose(0).inverse @ pose for pose in reference.poses()]
    write_tum(tmp_path / "odometry.txt", Trajectory.from_poses(reference.times, poses))
    return tmp_path / "odometry.txt"


def test_a_drive_is_tracked_with_odometry(localize, dense, odometry, tmp_path):
    options = ("--track", "--odometry", odometry, "--drift", "0.005", "--plot", tmp_path / "pictures")
    ended = localize(*options, "--plot-epochs", "11", scans=dense.scans, prior=dense.prior)
    assert ended.err == ""
    statuses = [row["status"] for row in rows_of(tmp_path / "poses.csv")]
    assert statuses[2:] == ["localized"] * 10
    assert ended.code == 0  # whether or not it knew at once where it was
    assert ("the track begins with epoch" in ended.out) == (statuses[0] != "localized")
    found, reference = read_trajectory(tmp_path / "poses.csv"), read_trajectory(dense.reference)
    true = np.array([reference.at(float(time)).position for time in found.times])
    assert np.abs(found.positions[:, :2] - true[:, :2]).max() < 0.1
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["000011.png"]  # of its default cells


def test_odometry_that_jumps_is_said_and_trusted_less(localize, dense, odometry, tmp_path):
    told, jumps = read_trajectory(odometry), tmp_path / "jumps.txt"
    off = np.random.default_rng(0).uniform(-1.0, 1.0, told.positions.shape) * [1.0, 1.0, 0.0]
    write_tum(jumps, Trajectory(told.times, told.positions + off, told.quaternions_xyzw))
    ended = localize("--track", "--odometry", jumps, scans=dense.scans, prior=dense.prior)
    assert ended.out.startswith("the odometry jumps as no vehicle does")
    assert {row["status"] for row in rows_of(tmp_path / "poses.csv")[-4:]} == {"localized"}
