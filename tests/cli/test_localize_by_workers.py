"""`maxcon localize` by several workers and of many drives: the rows of single calls, in one dataset that goes on."""

import json
import shutil
import signal
import sys

import pyarrow
import pyarrow.dataset
import pytest

from localized_poses import rows_of
from maxcon.drive.poses_table import FORMATS, PosesDataset
from maxcon.map.manifest import read_manifest, write_manifest

NARROW = ("--half-width", "1.2", "--heading-half-width-deg", "1", "--cell", "0.06")


def as_csv(row):
    """The cells of POSES.csv for a row of the dataset, without the milliseconds."""
    cells = {name: "" if row[name] is None else format(row[name], digits) for name, digits in FORMATS.items()}
    return cells | {"ms": ""}


def dataset_rows(out, name):
    flavour = pyarrow.dataset.partitioning(pyarrow.schema([("drive", pyarrow.string())]), flavor="hive")
    table = pyarrow.dataset.dataset(out, partitioning=flavour).to_table(filter=pyarrow.dataset.field("drive") == name)
    return [as_csv(row) for row in table.sort_by("epoch").to_pylist()]


@pytest.fixture
def single(localize, tmp_path):
    """Localize a drive by a single call, in this process; return its rows."""

    def run(name, scans, prior):
        ended = localize(*NARROW, scans=scans, prior=prior, out=f"{name}.single.csv")
        assert ended.code in (0, 1), ended
        return rows_of(tmp_path / f"{name}.single.csv")

    return run


@pytest.fixture
def table(drive, tmp_path):
    """A table of two drives: the small one under two names."""
    path = tmp_path / "drives.csv"
    own = f'"{drive.dataset.scans}",{drive.dataset.prior}'
    path.write_text(f"name,scans,prior\na,{own}\n0013,{own}\n")
    return path


@pytest.fixture
def long_table(long_drive, table):
    """The same, the first of them the long drive."""
    lines = table.read_text().splitlines()
    table.write_text("\n".join([lines[0], f"long,long,{long_drive[1]}", lines[2]]) + "\n")
    return table


@pytest.fixture
def many(maxcon, drive, table, out):
    """Localize the drives of the table in this process, with more options."""

    def run(*options, city=drive.city):
        return maxcon("localize", city, "--drives", table, "-o", out, *NARROW, "--workers", "1", *options)

    return run


# --- many drives, in this process ---
def test_many_drives_have_the_rows_of_single_calls_and_are_localized_once(many, drive, single, out):
    ended = many()
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines()[-1] == f"8 of 8 epochs of 2 drives localized; in {out}"
    wanted = single("a", drive.dataset.scans, drive.dataset.prior)
    for name in ("a", "0013"):
        assert dataset_rows(out, name) == wanted
    options = json.loads((out / "_options.json").read_text())
    assert options["options"]["method"]["thinning"] == 0.25 and "threads" not in options["options"]
    files = sorted(out.rglob("*"))
    assert [path.name for path in files if path.parent == out] == [
        "_drives.json", "_options.json", "drive=0013", "drive=a",
    ]  # fmt: skip
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")}
    assert many().out == f"8 of 8 epochs of 2 drives localized, 8 of them were there; in {out}\n"
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.parquet")} == before

    # What a killed call left: the rows of a drive wait until its file is there, and go then.
    (out / "_parts" / "0013").mkdir(parents=True)
    (out / "._drives.json.partial-12345678").mkdir()
    shutil.copy(out / "drive=0013" / "poses.parquet", out / "_parts" / "0013" / "000000000.parquet")
    assert "8 of them were there" in many().out and sorted(out.rglob("*")) == files
    (out / "_parts" / "0013").mkdir(parents=True)
    (out / "drive=0013" / "poses.parquet").rename(out / "_parts" / "0013" / "000000000.parquet")
    (out / "drive=0013" / ".poses.parquet.partial-12345678").mkdir()
    assert "8 of them were there" in many().out
    assert sorted(out.rglob("*")) == files and dataset_rows(out, "0013") == wanted
    shutil.rmtree(out / "drive=0013")
    assert "4 of them were there" in many().out


def test_another_map_prior_or_option_is_refused(many, maxcon, refused, drive, prior_rows, table, out, tmp_path):
    prior = tmp_path / "prior.txt"
    prior.write_text("".join(" ".join(row) + "\n" for row in prior_rows))
    table.write_text(f"name,scans,prior\na,{drive.dataset.scans},prior.txt\n")
    assert many().code == 0
    refused(
        many("--thinning", "0.5", "--max-gap", "2"),
        "with the same options", "options.method.thinning 0.25, got 0.5; options.drive.max_gap 0.5, got 2.0.",
    )  # fmt: skip
    other = tmp_path / "other.map"
    assert maxcon("map", "copy", drive.city, other).code == 0
    assert many(city=other).code == 0  # the same map elsewhere
    manifest = read_manifest(other)
    manifest.build["remark"] = "another"
    write_manifest(other, manifest)
    refused(many(city=other), "as it was begun, with map ", "localize it anew")
    prior.write_text(prior.read_text() + "# changed\n")
    refused(many(), "as it was begun, with prior ")
    shutil.rmtree(out)
    (out / "_parts" / "a").mkdir(parents=True)  # a call was killed before there was a row
    (out / "_parts" / "a" / ".000000000.parquet.partial-12345678").mkdir()
    (out / "_options.json").write_text('{"maxcon": "0.0.1"}')
    (out / "_drives.json").write_text('{"a": {"map": "another"}}')
    assert many().code == 0 and not (out / "_parts").exists()


def test_a_drive_that_cannot_be_localized_keeps_no_other_from_it(many, drive, table, out, tmp_path):
    (tmp_path / "far.txt").write_text("386400 9000000 0 0 0 0 0 1\n386404 9000000 0 0 0 0 0 1\n")
    lines = [f"far,{drive.dataset.scans},far.txt", "none,nowhere,far.txt"]
    table.write_text(table.read_text() + "\n".join(lines) + "\n")
    ended = many("--max-gap", "99")
    assert ended.code == 2 and ended.out == f"8 of 8 epochs of 2 drives localized; in {out}\n"
    assert ended.err.startswith("maxcon: Expected drives that can be localized, but 2 of 4 cannot; the first, ")
    assert ended.err.count("\n") == 1


def test_toml_names_a_map_for_each(drive, maxcon, tmp_path):
    table, dataset = tmp_path / "drives.toml", drive.dataset
    entry = f'scans = "{dataset.scans}"\nprior = "{dataset.prior}"\nmap = "{drive.city}"\n'
    table.write_text(f'[[drive]]\nname = "0001"\n{entry}')
    ended = maxcon("localize", "--drives", table, "-o", tmp_path / "out", *NARROW, "--workers", "1")
    assert (ended.code, ended.err) == (0, "") and len(dataset_rows(tmp_path / "out", "0001")) == 4


def test_what_has_no_effect_is_refused(drive, table, maxcon, refused, tmp_path):
    out = tmp_path / "new"
    for arguments in (("SCANS",), ("--prior", table), ("--resume",), ("--overwrite",), ("--tum", "a"), ("--plot", "a")):
        words = f"either --drives, where a table names files and a call goes on, or {arguments[0]}, got both"
        refused(maxcon("localize", drive.city, *arguments, "--drives", table, "-o", out), words)
    refused(maxcon("localize", drive.city, "-o", out), "got no SCANS")
    refused(maxcon("localize", "-o", out), "got no MAP")
    refused(maxcon("localize", "--drives", table, "-o", out), "Name it there, or one MAP for all")
    refused(maxcon("localize", drive.city, "--drives", table, "-o", tmp_path), "it holds")
    assert not out.exists()


# --- workers ---
@pytest.mark.clusters
def test_workers_write_the_table_of_one_process(localize, long_drive, single, tmp_path):
    table, pictures = tmp_path / "poses.csv", tmp_path / "pictures"
    scans, prior, _ = long_drive
    plot = ("--plot", pictures, "--plot-epochs", "0,39")
    ended = localize(*NARROW, "--workers", "2", *plot, scans=scans, prior=prior)
    assert (ended.code, ended.err) == (0, "") and "40 of 40 epochs localized" in ended.out
    wanted = single("long", scans, prior)
    assert rows_of(table) == wanted
    assert sorted(path.name for path in pictures.iterdir()) == ["000000.png", "000039.png"]
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:18]))
    assert localize(*NARROW, "--workers", "2", "--resume", scans=scans, prior=prior).code == 0
    assert rows_of(table) == wanted


@pytest.mark.clusters
@pytest.mark.skipif(sys.platform == "win32", reason="no POSIX signals to stop a process with")
@pytest.mark.parametrize("name", ["SIGINT", "SIGKILL"])
def test_drives_that_are_stopped_go_on(drive, long_table, long_drive, maxcon, stopped_when, single, out, name):
    number = getattr(signal, name)
    arguments = ("localize", drive.city, "--drives", long_table, "-o", out, *NARROW, "--workers", "2", "--quiet")
    ended = stopped_when(number, lambda _: list(out.glob("_parts/long/[!.]*.parquet")), *arguments)
    if name == "SIGINT":
        assert ended == (128 + number, "maxcon: stopped\n")
    kept, others = (PosesDataset(out).table(drive).read().to_pylist() for drive in ("long", "0013"))
    ended = maxcon(*arguments)
    assert ended.code == 0 and f"{len(kept) + len(others)} of them were there" in ended.out
    assert dataset_rows(out, "long") == single("long", *long_drive[:2])
    after = {row["epoch"]: row for row in PosesDataset(out).table("long").read().to_pylist()}
    assert kept and all(after[row["epoch"]] == row for row in kept)  # times and all: not made again
    assert sorted(path.name for path in out.iterdir()) == ["_drives.json", "_options.json", "drive=0013", "drive=long"]


@pytest.mark.clusters
def test_a_cluster_that_somebody_started_makes_the_same_rows(drive, long_drive, long_table, dask, maxcon, single, out):
    cluster = dask(2).scheduler_address
    arguments = ("localize", drive.city, "--drives", long_table, "-o", out, *NARROW, "--scheduler", cluster)
    ended = maxcon(*arguments)
    # Its workers may be starting still.
    assert ended.code == 0 and set(ended.err.splitlines()) <= {f"waiting up to 30 s for a worker at {cluster}"}
    assert ended.out == f"44 of 44 epochs of 2 drives localized; in {out}\n"
    for name, parts in {"long": long_drive[:2], "0013": (drive.dataset.scans, drive.dataset.prior)}.items():
        assert dataset_rows(out, name) == single(name, *parts)
