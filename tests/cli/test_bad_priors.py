# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`localize` with priors that cannot be used: one line, and no table."""

import csv

import pytest

SIGMAS = ("--sigma-position", "1", "--sigma-heading-deg", "0.5")


@pytest.fixture
def rows(drive):
    """The prior's rows of numbers, as text."""
    return [line.split() for line in drive.dataset.prior.read_text().splitlines() if not line.startswith("#")]


@pytest.fixture
def not_localized(maxcon, refused, drive, tmp_path):
    """Check that localizing with a prior is refused with these words, and that nothing was written."""

    def check(content, *words, name="prior.txt", options=()):
        path = tmp_path / name
        if content is not None:
            path.write_text(content if isinstance(content, str) else "".join(f"{' '.join(row)}\n" for row in content))
        out = tmp_path / "out"
        out.mkdir(exist_ok=True)
        outputs = ("-o", out / "poses.csv", "--tum", out / "poses.txt", "--plot", out / "pictures")
        refused(maxcon("localize", drive.city, drive.dataset.scans, "--prior", path, *outputs, *options), *words)
        assert list(out.iterdir()) == []

    return check


def test_no_file(not_localized, tmp_path):
    not_localized(None, tmp_path / "prior.txt", "no such file", "Check the path")


def test_an_empty_file(not_localized, tmp_path):
    not_localized("", tmp_path / "prior.txt", "at least one pose")
    not_localized("# only a comment\n", "at least one pose")
    not_localized("", tmp_path / "prior.csv", "at least one pose", name="prior.csv")


def test_wrong_suffix(not_localized, rows):
    not_localized(rows, "prior.json", ".txt, .tum or .csv", "Rename it", name="prior.json")


def test_zero_quaternions(not_localized, rows, tmp_path):
    for row in rows[1:]:
        row[4:] = "0000"
    not_localized(rows, f"{tmp_path / 'prior.txt'}, line 2", "unit quaternion", "length 0")


@pytest.mark.parametrize("row", ["zero", "words", "cut"])
def test_one_senseless_row_is_a_row_with_its_status(maxcon, drive, rows, tmp_path, row):
    rows[1] = {"zero": [*rows[1][:4], *"0000"], "words": ["lost"] * 8, "cut": rows[1][:3]}[row]
    (tmp_path / "prior.txt").write_text("".join(f"{' '.join(row)}\n" for row in rows))
    ended = maxcon(
        "localize", drive.city, drive.dataset.scans, "--prior", tmp_path / "prior.txt", "-o", tmp_path / "poses.csv"
    )  # fmt: skip
    assert (ended.code, ended.err) == (1, ""), ended
    assert f"1 rows of the prior are left out; the first: {tmp_path / 'prior.txt'}, line 2: Expected" in ended.out
    with (tmp_path / "poses.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["status"] for row in table] == ["localized", "no prior", "localized", "localized"]
    assert "gap" in table[1]["reason"]


def test_times_out_of_order(not_localized, rows, tmp_path):
    not_localized(rows[::-1], f"{tmp_path / 'prior.txt'}, line 2", "increase", "Sort")
    not_localized([rows[0], rows[0]], "line 2", "increase")


def test_numbers_that_are_none(not_localized, rows, tmp_path):
    for text in ("nan", "inf", "x", "1,5"):
        not_localized([[rows[0][0], text, *rows[0][2:]]], f"{tmp_path / 'prior.txt'}, line 1", repr(text))
    not_localized([rows[0][:7]], "line 1", "8 columns", "got 7")


def test_a_csv_without_the_columns(not_localized):
    not_localized("time,lat,lon\n1,2,3\n", "prior.csv", "time,x,y,z,roll,pitch,heading", name="prior.csv")


SIGMA_COLUMNS = "time,x,y,z,roll,pitch,heading,sigma_x,sigma_y,sigma_heading_deg\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (SIGMA_COLUMNS.replace(",sigma_y", "") + "1,2,3,4,0,0,0,1,1\n", ("line 1", "sigma_x", "no 'sigma_y'")),
        (SIGMA_COLUMNS + "1,2,3,4,0,0,0,1,-1,1\n", ("line 2", ">= 0", "got -1")),
        (SIGMA_COLUMNS + "1,2,3,4,0,0,0,1,nan,1\n", ("line 2", "finite", "'nan'")),
        (SIGMA_COLUMNS + "1,2,3,4,0,0,0,1,,1\n", ("line 2", "finite", "''")),
    ],
)
def test_covariances_that_are_none(not_localized, tmp_path, content, words):
    not_localized(content, f"{tmp_path / 'prior.csv'}, ", *words, name="prior.csv")


def test_a_binary_file(not_localized, tmp_path):
    (tmp_path / "prior.txt").write_bytes(b"\xff\xfe" + bytes(range(256)) * 100)
    not_localized(None, tmp_path / "prior.txt", "text")


def test_times_that_do_not_overlap(not_localized, rows):
    for row in rows:
        row[0] = str(float(row[0]) + 1e9)
    not_localized(rows, "386400.000", "same clock", "--times")


def test_a_prior_outside_the_map(not_localized, rows):
    for row in rows:
        row[2] = str(float(row[2]) - 1_000_000)
    not_localized(rows, "inside the map", "y 5801", "same CRS")


def test_a_prior_far_beyond_any_map(not_localized, rows):
    for row in rows:
        row[1] = "1e300"
    not_localized(rows, "inside the map")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ("--half-width", "3000", "--heading-half-width-deg", "180", "--cell", "0.06"),
            ("cells", "7.21e+12", "Narrow"),
        ),
        (("--half-width", "-3"), ("half width >= 0", "-3")),
        (("--half-width", "nan"), ("nan",)),
        (("--half-width", "60000"), ("cells", "Narrow")),
        (("--heading-half-width-deg", "-1"), ("-1",)),
        (("--cell", "0.05", "--half-width", "1"), ("voxel edge", "0.05")),
        (("--cell", "0"), ("step > 0",)),
        (("--sigma-position", "1"), ("--sigma-position and --sigma-heading-deg", "no --sigma-heading-deg")),
        (("--sigma-heading-deg", "1"), ("together", "no --sigma-position", "0 if it is exact")),
        (("--sigmas", "3"), ("together", "no --sigma-position")),
        ((*SIGMAS, "--half-width", "3"), ("either half widths or standard deviations", "--half-width")),
        ((*SIGMAS, "--heading-half-width-deg", "2"), ("either", "--heading-half-width-deg", "Leave one")),
        (("--sigmas", "3", "--half-width", "3"), ("either", "--half-width")),
        (("--sigma-position", "-1", "--sigma-heading-deg", "1"), ("--sigma-position", ">= 0", "-1")),
        (("--sigma-position", "1", "--sigma-heading-deg", "nan"), ("--sigma-heading-deg", "nan")),
        ((*SIGMAS, "--sigmas", "0"), ("--sigmas > 0", "got 0.0", "3")),
        ((*SIGMAS, "--sigmas", "inf"), ("--sigmas > 0", "inf")),
        (("--largest-half-width", "9"), ("together with --largest-half-width", "CSV prior", "no --track")),
        (("--largest-half-width", "9", "--half-width", "3"), ("either", "--half-width")),
        ((*SIGMAS, "--largest-half-width", "0"), ("largest half width above 0 m", "got 0.0", "24 m")),
        (("--sigma-position", "1e200", "--sigma-heading-deg", "1"), ("finite",)),
        ((*SIGMAS, "--heading-step-deg", "0"), ("step > 0",)),
        (("--heading-step-deg", "0"), ("step > 0",)),
        (("--heading-step-deg", "-0.5"), ("step > 0",)),
        (("--min-range", "-1"), ("min_range", "-1")),
        (("--min-range", "5", "--max-range", "4"), ("5.0 m and 4.0 m",)),
        (("--max-range", "nan"), ("nan",)),
        (("--max-gap", "-1"), ("max_gap", "-1")),
        (("--plot-epochs", "nonsense"), ("--plot-epochs", "0 to 3", "'nonsense'")),
        (("--plot-epochs", "4"), ("--plot-epochs", "0 to 3", "'4'")),
        (("--plot-epochs", "2-1"), ("--plot-epochs", "'2-1'")),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_options_with_impossible_numbers(not_localized, rows, options, words):
    not_localized(rows, *words, options=options)


def test_epochs_to_plot_without_a_folder(maxcon, refused, drive, tmp_path):
    arguments = ("--prior", drive.dataset.prior, "-o", tmp_path / "poses.csv", "--plot-epochs", "0")
    refused(maxcon("localize", drive.city, drive.dataset.scans, *arguments), "--plot DIR")
    assert list(tmp_path.iterdir()) == []
