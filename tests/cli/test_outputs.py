# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Outputs that cannot be written: told before the work where that can be, and never half there (D10)."""

import signal

import pytest

# Windows has other words for what is wrong with a path, too.
resource = pytest.importorskip("resource", reason="no POSIX limits to the size of files")

LIMIT = 200_000


def _small_disk(limit=LIMIT):
    """In the child: no file may grow beyond `limit` bytes, as on a disk that is full."""

    def set_limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return set_limit


@pytest.fixture
def localize(drive):
    """The arguments that localize the drive."""
    return ("localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o")


@pytest.fixture
def build(drive):
    """The arguments that build the map of the drive."""
    trajectory = ("--trajectory", drive.dataset.map_trajectory)
    return ("map", "build", *drive.dataset.map_clouds, *trajectory, "-o")


def test_no_folder_for_the_map(maxcon, refused, build, out):
    refused(maxcon(*build, out / "missing" / "city.map"), out / "missing" / "city.map", "No such file or directory")
    assert list(out.iterdir()) == []


def test_no_folder_for_the_dataset(maxcon, refused, out):
    refused(maxcon("simulate", out / "missing" / "dataset"), out / "missing", "No such file or directory")
    refused(maxcon("simulate", out), out, "not to exist", "--overwrite")
    assert list(out.iterdir()) == []


def test_a_dataset_is_not_written_over_something_else(maxcon, refused, drive, out):
    (out / "thesis.tex").touch()
    refused(maxcon("simulate", out, "--overwrite"), out, "a simulated dataset", "thesis.tex")
    refused(maxcon("simulate", drive.city, "--overwrite"), drive.city, "a simulated dataset", "ground")
    assert sorted(path.name for path in out.iterdir()) == ["thesis.tex"]


@pytest.mark.parametrize("option", ["-o", "--tum"])
def test_tables_that_cannot_be_written_are_told_first(maxcon, refused, localize, out, option, monkeypatch):
    monkeypatch.setattr("maxcon.drive.localize.localize_drive", None)
    (out / "file").touch()
    for path, got in (
        (out / "missing" / "poses.csv", "No such file or directory"),
        (out / "file" / "poses.csv", "Not a directory"),
        (out / ("a" * 300), "too long"),
        ("/proc/poses.csv", "No such file or directory"),
        (out, "the folder"),
    ):
        arguments = (path,) if option == "-o" else (out / "poses.csv", option, path)
        refused(maxcon(*localize, *arguments), path, got)
    assert sorted(path.name for path in out.iterdir()) == ["file"]


def test_outputs_that_replace_each_other_or_the_prior(maxcon, refused, localize, drive, out):
    before = drive.dataset.prior.read_bytes()
    words = ("--prior, --out and --tum", "twice")
    refused(maxcon(*localize, drive.dataset.prior), *words)
    refused(maxcon(*localize, out / "poses.txt", "--tum", out / "." / "poses.txt"), *words)
    assert drive.dataset.prior.read_bytes() == before
    assert list(out.iterdir()) == []


def test_a_file_where_the_pictures_shall_go(maxcon, refused, localize, out):
    (out / "pictures").touch()
    refused(maxcon(*localize, out / "poses.csv", "--plot", out / "pictures"), "the file", out / "pictures")
    refused(maxcon(*localize, out / "poses.csv", "--plot", out / "pictures" / "new"), out / "pictures" / "new")
    assert sorted(path.name for path in out.iterdir()) == ["pictures"]


def test_names_that_are_none(maxcon, refused, localize, build, out, monkeypatch):
    monkeypatch.chdir(out)
    for name in (".", "..", "/"):
        refused(maxcon(*build, name), name, "Put a name")
        refused(maxcon(*build, name, "--overwrite"), name)
        refused(maxcon(*localize, name), name)
        refused(maxcon("demo", "--out", name), name)
        refused(maxcon("simulate", name), name)
    refused(maxcon(*localize, "poses.csv", "--plot", "a" * 300), "too long")
    assert list(out.iterdir()) == []


@pytest.mark.kills
@pytest.mark.parametrize("limit", [2_000, 200_000, 1_000_000])
def test_the_disk_is_full_while_building(maxcon_in_process_of_its_own, refused, build, out, limit):
    ended = maxcon_in_process_of_its_own(*build, out / "city.map", preexec_fn=_small_disk(limit))
    refused(ended, out / "city.map", "free disk space", "nothing was written")
    assert list(out.iterdir()) == []


@pytest.fixture
def nothing_to_compile(maxcon_in_process_of_its_own, localize, tmp_path):
    """Compiled code is kept in files too: it must be there before the disk is full."""
    options = ("--plot", tmp_path / "warm", "--plot-epochs", "0")
    maxcon_in_process_of_its_own(*localize, tmp_path / "warm.csv", *options)


@pytest.mark.kills
@pytest.mark.usefixtures("nothing_to_compile")
def test_the_disk_is_full_while_writing_poses(maxcon_in_process_of_its_own, refused, localize, out):
    (out / "poses.csv").write_text("the table of yesterday")
    arguments = (out / "poses.csv", "--overwrite")
    ended = maxcon_in_process_of_its_own(*localize, *arguments, preexec_fn=_small_disk(100))
    refused(ended, out / "poses.csv", "File too large", "nothing was written")
    assert sorted(path.name for path in out.iterdir()) == ["poses.csv"]
    assert (out / "poses.csv").read_text() == "the table of yesterday"


@pytest.mark.kills
@pytest.mark.usefixtures("nothing_to_compile")
def test_the_disk_is_full_while_drawing(maxcon_in_process_of_its_own, refused, localize, out):
    arguments = (out / "poses.csv", "--plot", out / "pictures", "--plot-epochs", "0")
    ended = maxcon_in_process_of_its_own(*localize, *arguments, preexec_fn=_small_disk(20_000))
    refused(ended, out / "pictures" / "000000.png", "File too large", "1 of 4 epochs are kept", "--resume")
    assert sorted(path.name for path in out.iterdir()) == ["pictures", "poses.csv"]
    assert list((out / "pictures").iterdir()) == []
    assert len((out / "poses.csv").read_text().splitlines()) == 2


@pytest.mark.kills
@pytest.mark.usefixtures("nothing_to_compile")
def test_the_disk_is_full_half_way(maxcon_in_process_of_its_own, maxcon, refused, localize, out):
    ended = maxcon_in_process_of_its_own(*localize, out / "poses.csv", preexec_fn=_small_disk(1_500))
    refused(ended, out / "poses.csv", "File too large", "epochs are kept", "--resume")
    n_rows = int(ended.err.partition(" of 4 epochs")[0].rpartition(" ")[2])
    assert 0 < n_rows < 4
    lines = (out / "poses.csv").read_text().splitlines()
    assert len(lines) == 1 + n_rows
    assert lines[-1].count(",") == lines[0].count(",")
    assert maxcon(*localize, out / "poses.csv", "--resume").code == 0


@pytest.mark.kills
def test_the_disk_is_full_while_simulating(maxcon_in_process_of_its_own, refused, out):
    arguments = ("simulate", out / "dataset", "--epochs", "1")
    ended = maxcon_in_process_of_its_own(*arguments, preexec_fn=_small_disk(50_000))
    refused(ended, out / "dataset", "nothing was written")
    assert list(out.iterdir()) == []


def test_the_reader_of_the_output_goes_away(maxcon_process, drive):
    with maxcon_process("map", "info", drive.city) as process:
        process.stdout.close()
        err = process.stderr.read()
        process.wait(timeout=600)
    assert "Traceback" not in err
