# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize`: tables, pictures, options, and drives that are localized in part."""

import csv
import inspect
import math
import re

import numpy as np
import pytest

import maxcon as library
from maxcon.cli.localize import localize as command
from maxcon.cli.drive_output import parse_epochs
from maxcon.cli.space_options import LARGEST_HALF_WIDTH, SIGMAS
from maxcon.drive.within_sigmas import WithinSigmas
from maxcon.errors import OptionError
from maxcon.io.trajectories import read_trajectory, write_csv

POSE = ("x", "y", "z", "roll", "pitch", "heading")


def _rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def _without_ms(path):
    return [row | {"ms": ""} for row in _rows(path)]


@pytest.fixture
def localize(maxcon, drive, tmp_path):
    """Localize the drive into poses.csv; `prior` replaces its priors."""

    def run(*options, prior=None, out="poses.csv"):
        prior = prior or drive.dataset.prior
        return maxcon(
            "localize", drive.city, drive.dataset.scans, "--prior", prior, "-o", tmp_path / out, "--overwrite", *options
        )

    return run


@pytest.mark.parametrize(
    "options",
    [
        ("--objective", "count"),
        ("--objective", "max-eigenvalue"),
        ("--multiplicity", "points"),
        ("--half-width", "2.7", "--heading-half-width-deg", "3", "--heading-step-deg", "1"),
        ("--min-range", "3", "--max-range", "60"),
    ],
    ids=lambda options: " ".join(options[:2]),
)
def test_options_of_the_search(localize, drive, tmp_path, options):
    ended = localize(*options)
    assert (ended.code, ended.err) == (0, ""), ended
    found = read_trajectory(tmp_path / "poses.csv")
    np.testing.assert_array_equal(found.times, drive.reference.times)
    assert np.abs(found.positions[:, :2] - drive.reference.positions[:, :2]).max() < 0.2


def test_standard_deviations_instead_of_half_widths(localize, drive, tmp_path):
    sigmas = ("--sigma-position", "1", "--sigma-heading-deg", "0.7", "--heading-step-deg", "0.75")
    fixed = ("--half-width", "2.04", "--heading-half-width-deg", "1.5", "--heading-step-deg", "0.75")
    ended = localize(*sigmas, "--sigmas", "2", out="sigmas.csv")
    assert (ended.code, ended.err) == (0, ""), ended
    localize(*fixed, out="fixed.csv")
    assert _without_ms(tmp_path / "sigmas.csv") == _without_ms(tmp_path / "fixed.csv")
    localize(*sigmas, out="default.csv")
    wider = ("--half-width", "3.06", "--heading-half-width-deg", "2.25", "--heading-step-deg", "0.75")
    localize(*wider, out="wider.csv")
    assert _without_ms(tmp_path / "default.csv") == _without_ms(tmp_path / "wider.csv")


def test_a_prior_of_few_centimetres_is_searched_for_within_a_metre(localize):
    ended = localize("--sigma-position", "0.04", "--sigma-heading-deg", "0", "--wider", "0")
    assert ended.code in (0, 1)
    assert "\nwindows from --sigma-position: half width 1.0 m, 1.0 degrees\n" in ended.out


@pytest.fixture
def known_prior(drive, tmp_path):
    """Write the drive's prior as CSV, with a standard deviation of each position, m, and of headings, degrees."""

    def write(sigmas, sigma_heading_deg=0.7):
        prior = read_trajectory(drive.dataset.prior)
        turn = math.radians(sigma_heading_deg)
        covariances = [np.diag([sigma**2, 0.5 * sigma**2, turn**2]) for sigma in sigmas]
        write_csv(
            tmp_path / "known.csv",
            library.Trajectory(prior.times, prior.positions, prior.quaternions_xyzw, np.array(covariances)),
        )
        return tmp_path / "known.csv"

    return write


def test_windows_are_those_of_the_priors_covariances(localize, known_prior):
    prior = known_prior([0.5, 1.0, 1.0, 1.2])
    ended = localize(prior=prior)
    assert (ended.code, ended.err) == (0, ""), ended
    assert "\nwindows from the prior's covariances: half width 1.5 to 3.6 m, 2.1 degrees\n" in ended.out
    ended = localize("--sigmas", "2", "--largest-half-width", "2.2", prior=prior)
    assert "\nwindows from the prior's covariances: half width 1.0 to 2.2 m, 1.4 degrees; 1 of them cut at 2.2 m\n" in (
        ended.out
    )


def test_windows_from_sigmas_that_are_too_small_grow(localize, known_prior, drive, tmp_path):
    lines = known_prior([0.01] * 4, 0.01).read_text().splitlines()
    moved = tmp_path / "moved.csv"
    rows = [line.split(",") for line in lines[1:]]
    far = [",".join([row[0], str(float(row[1]) + 6.0), *row[2:]]) for row in rows]
    moved.write_text("\n".join([lines[0], *far]) + "\n")
    ended = localize(prior=moved)
    assert (ended.code, ended.err) == (0, ""), ended
    assert "half width 1.0 m, 1.0 degrees\n4 were in doubt and searched for farther around\n" in ended.out
    assert "are its sigmas too small?" in ended.out
    found = read_trajectory(tmp_path / "poses.csv")
    assert np.abs(found.positions[:, :2] - drive.reference.positions[:, :2]).max() < 0.2


def test_huge_sigmas_are_cut_and_said(localize, known_prior):
    ended = localize("--largest-half-width", "6", prior=known_prior([40.0] * 4))
    assert (ended.code, ended.err) == (0, ""), ended
    assert "half width 6.0 m, 2.1 degrees; 4 of them cut at 6 m\n" in ended.out
    assert "3 sigma of the prior are 120 m, searched were 6 m" in ended.out


@pytest.mark.parametrize(
    "options",
    [
        ("--half-width", "3"),
        ("--heading-half-width-deg", "2"),
        ("--sigma-position", "1", "--sigma-heading-deg", "0.7"),
        ("--track",),
    ],
    ids=lambda options: options[0],
)
def test_what_is_given_is_used_instead_of_the_priors_covariances(localize, known_prior, options):
    ended = localize(*options, prior=known_prior([1.0] * 4))
    if options[0] == "--sigma-position":
        assert "\nwindows from --sigma-position: half width 3.0 m, 2.1 degrees\n" in ended.out
    else:
        assert f"\nthe prior's covariances are not used: {options[0]}\n" in ended.out


def test_pictures_show_the_window_of_their_epoch(localize, known_prior, tmp_path):
    ended = localize("--plot", tmp_path / "pictures", "--plot-epochs", "1", prior=known_prior([0.5] * 4))
    assert (ended.code, ended.err) == (0, ""), ended
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["000001.png"]


def test_poses_with_covariances_are_a_prior(localize, tmp_path):
    assert localize().code == 0
    ended = localize(prior=tmp_path / "poses.csv", out="again.csv")
    assert (ended.code, ended.err) == (0, ""), ended
    assert "windows from the prior's covariances: half width 1.0 m, 1.0 degrees" in ended.out


def test_the_answer_does_not_depend_on_the_threads(localize, tmp_path):
    for threads in (1, 2):
        assert localize("--threads", threads, out=f"{threads}.csv").code == 0
    assert _without_ms(tmp_path / "1.csv") == _without_ms(tmp_path / "2.csv")


@pytest.mark.parametrize("objective", ["helmert", "count"])
def test_the_answer_does_not_depend_on_the_search(localize, tmp_path, objective):
    for search in ("exhaustive", "branch-and-bound"):
        assert localize("--objective", objective, "--search", search, out=f"{search}.csv").code == 0
    assert _without_ms(tmp_path / "exhaustive.csv") == _without_ms(tmp_path / "branch-and-bound.csv")


def test_scores_are_those_of_the_objective(localize, tmp_path):
    localize("--objective", "count", "--multiplicity", "points", out="count.csv")
    scores = [float(row["score"]) for row in _rows(tmp_path / "count.csv")]
    assert all(score == int(score) and score > 500 for score in scores)


OWN = """
class Fewest:
    def score(self, moments):
        return moments[..., 0] + 0.0

half = Fewest()
silly = 3
"""


@pytest.mark.parametrize("name", ["Fewest", "half"])
def test_an_own_objective_scores(localize, tmp_path, monkeypatch, name):
    (tmp_path / f"own_{name}.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    assert localize("--objective", f"own_{name}:{name}", out="own.csv").code == 0
    assert localize("--objective", "count", out="count.csv").code == 0
    scores = [[row["score"] for row in _rows(tmp_path / f"{which}.csv")] for which in ("own", "count")]
    assert scores[0] == scores[1]


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("nowhere_at_all:Name", "ModuleNotFoundError"),
        ("own_bad:Missing", "AttributeError"),
        ("own_bad:silly", "`score"),
        (":Name", "ValueError"),
        ("Helmert", "'count', 'helmert', 'max-eigenvalue'"),
    ],
)
def test_an_objective_that_is_none_is_refused(localize, tmp_path, monkeypatch, word, reason):
    (tmp_path / "own_bad.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    ended = localize("--objective", word)
    assert ended.code == 2
    assert reason in ended.err
    assert ended.err.count("\n") == 1
    assert not (tmp_path / "poses.csv").exists()


def test_an_existing_table_is_replaced(localize, tmp_path):
    (tmp_path / "poses.csv").write_text("old")
    assert localize().code == 0
    assert len(_rows(tmp_path / "poses.csv")) == 4


def test_epochs_without_an_answer_have_no_pose_and_end_with_1(localize, drive, tmp_path):
    lines = drive.dataset.prior.read_text().splitlines()
    header = [line for line in lines if line.startswith("#")]
    first, _, third, fourth = (line for line in lines if not line.startswith("#"))
    time, x, *others = third.split()
    outside = " ".join([time, str(float(x) + 10_000.0), *others])
    prior = tmp_path / "prior.txt"
    prior.write_text("\n".join([*header, first, outside, fourth]) + "\n")
    ended = localize("--tum", tmp_path / "found.tum", prior=prior)
    assert (ended.code, ended.err) == (1, "")
    assert ended.out.startswith("2 of 4 epochs localized, median ")
    assert "\n1 no prior: The prior trajectory has no pose" in ended.out
    assert "\n1 outside the map: The prior lies outside the map.\n" in ended.out
    rows = _rows(tmp_path / "poses.csv")
    assert [row["status"] for row in rows] == ["localized", "no prior", "outside the map", "localized"]
    for row in rows:
        is_empty = {row[name] == "" for name in POSE}
        assert is_empty == {row["status"] != "localized"}
        assert row["time"] != "" and row["ms"] != ""
    for found in (tmp_path / "poses.csv", tmp_path / "found.tum"):
        np.testing.assert_allclose(read_trajectory(found).times, drive.reference.times[[0, 3]], atol=1e-6)


def test_no_epoch_localized_writes_a_table_and_no_trajectory(localize, drive, tmp_path):
    ended = localize("--min-range", "119.99", "--max-range", "120", "--tum", tmp_path / "found.tum")
    assert (ended.code, ended.err) == (1, "")
    assert ended.out.startswith("0 of 4 epochs localized")
    assert "\n4 no points: The scan has no point within the range limits.\n" in ended.out
    assert [row["score"] for row in _rows(tmp_path / "poses.csv")] == [""] * 4
    assert not (tmp_path / "found.tum").exists()
    assert ended.out.endswith("found.tum is not written\n")


def test_a_prior_at_the_wrong_height_matches_nothing(localize, drive, tmp_path):
    lines = drive.dataset.prior.read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    prior = tmp_path / "high.txt"
    prior.write_text("".join(f"{' '.join([*row[:3], '500', *row[4:]])}\n" for row in rows))
    ended = localize(prior=prior)
    assert ended.code == 1
    assert "\n4 no match: No scan point matched the map" in ended.out


@pytest.mark.parametrize("options", [(), ("--height-half-width", "0.6")])
def test_a_prior_half_a_metre_too_high_is_laid_on_the_ground(localize, drive, tmp_path, options):
    lines = drive.dataset.prior.read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    prior = tmp_path / "high.txt"
    prior.write_text("".join(f"{' '.join([*row[:3], str(float(row[3]) + 0.5), *row[4:]])}\n" for row in rows))
    assert localize(*options, prior=prior).code == 0
    for row in _rows(tmp_path / "poses.csv"):
        assert abs(float(row["z"]) - drive.reference.at(float(row["time"])).z) < 0.05


def test_a_space_too_small_for_the_prior_is_searched_wider(localize):
    ended = localize("--half-width", "0.12")
    assert ended.code == 0
    assert "were in doubt and searched for farther around" in ended.out


def test_a_space_too_small_for_the_prior_is_told(localize):
    ended = localize("--half-width", "0.12", "--heading-half-width-deg", "0", "--wider", "0")
    assert ended.code == 1
    assert "0 of 4 epochs localized" in ended.out
    assert re.search(r"\d (at the rim|few matches|undetermined|ambiguous): ", ended.out)


def test_prior_as_csv_and_times_from_a_file(localize, maxcon, drive, tmp_path):
    assert localize().code == 0
    times = tmp_path / "clock.txt"
    times.write_text((drive.dataset.scans / "times.txt").read_text())
    ended = localize("--times", times, prior=tmp_path / "poses.csv", out="again.csv")
    assert ended.code == 0
    again, first = (read_trajectory(tmp_path / name) for name in ("again.csv", "poses.csv"))
    assert np.abs(again.positions - first.positions).max() < 0.0601


def test_pictures(localize, tmp_path):
    pictures = tmp_path / "new" / "pictures"
    ended = localize("--plot", pictures, "--plot-epochs", "0,2-2")
    assert (ended.code, ended.err) == (0, "")
    assert sorted(path.name for path in pictures.iterdir()) == ["000000.png", "000002.png"]
    for path in pictures.iterdir():
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 20_000


@pytest.mark.parametrize(
    ("text", "n_epochs", "wanted"),
    [
        ("0", 1, {0}),
        ("0,2", 3, {0, 2}),
        (" 1 , 0-1", 3, {0, 1}),
        ("all", 3, {0, 1, 2}),
        ("ALL", 2, {0, 1}),
        (None, 3, {0, 1, 2}),
        (None, 40, set(range(0, 40, 4))),
        (None, 41, set(range(0, 41, 5))),
        ("3-5,4", 6, {3, 4, 5}),
    ],
)
def test_lists_of_epochs(text, n_epochs, wanted):
    assert parse_epochs(text, n_epochs) == wanted


@pytest.mark.parametrize(
    "text", ["", ",", "-1", "1-", "2-1", "9", "0-9", "1.5", "one", "²", "0;1", "9" * 5000, "0-1-2"]
)
def test_lists_of_epochs_that_are_none(text):
    with pytest.raises(OptionError, match=r"--plot-epochs to list epochs from 0 to 3, such as 0,5,10-20, or all"):
        parse_epochs(text, 4)


def test_what_is_not_given_is_what_the_method_takes():
    given = {name: parameter.default for name, parameter in inspect.signature(command).parameters.items()}
    method, trust = library.MaximumConsensus(), library.Trust()
    assert given["thinning"] == method.thinning
    assert given["weighting"] == method.weighting
    assert given["multiplicity"] == method.multiplicity
    assert given["search"] == method.search
    assert given["objective"] == method.objective.name
    prior = library.Trajectory.from_poses([0.0], [library.Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)])
    within = WithinSigmas(method, prior)
    assert (within.sigmas, within.largest_half_width) == (SIGMAS, LARGEST_HALF_WIDTH)
    assert (given["least_share"], given["largest_runner_up"]) == (trust.least_share, trust.largest_runner_up)


def test_half_widths_are_rounded_up_to_whole_cells(localize, drive, tmp_path):
    given = ("--half-width", "2.5", "--heading-half-width-deg", "1.2", "--cell", "0.06")
    ended = localize(*given, out="given.csv")
    assert (ended.code, ended.err) == (0, ""), ended
    whole = ("--half-width", "2.52", "--heading-half-width-deg", "1.5", "--cell", "0.06")
    localize(*whole, out="whole.csv")
    assert _without_ms(tmp_path / "given.csv") == _without_ms(tmp_path / "whole.csv")
