"""Outputs that cannot be written: told before the work where that can be, and never half there (D10)."""

import signal

import pytest

from maxcon.cli import one_line

# Windows has other words for what is wrong with a path, too.
resource = pytest.importorskip("resource", reason="no POSIX limits to the size of files")

LIMIT = 200_000


def _small_disk(limit=LIMIT):
    """In the child: no file may grow beyond `limit` bytes, as on a disk that is full."""

    def set_limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return set_limit


def test_no_folder_for_a_map_or_a_dataset_and_nothing_is_written_over(maxcon, refused, drive, out):
    for command in (drive.build, ("simulate",)):
        refused(maxcon(*command, out / "missing" / "a"), out / "missing", "No such file or directory")
    refused(maxcon("simulate", out), out, "not to exist", "--overwrite")
    (out / "thesis.tex").touch()
    refused(maxcon("simulate", out, "--overwrite"), out, "a simulated dataset", "thesis.tex")
    refused(maxcon("simulate", drive.city, "--overwrite"), drive.city, "a simulated dataset", "ground")
    assert [path.name for path in out.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("option", ["-o", "--tum"])
def test_tables_that_cannot_be_written_are_told_first(maxcon, refused, drive, out, option, monkeypatch):
    monkeypatch.setattr("maxcon.drive.localize.Drive.of", None)
    (out / "file").touch()
    for path, got in (
        (out / "file" / "poses.csv", "Not a directory"), (out / ("a" * 300), "too long"), (out, "folder"),
    ):  # fmt: skip
        arguments = (path,) if option == "-o" else (out / "poses.csv", option, path)
        refused(maxcon(*drive.localize, *arguments), path, got)
    assert sorted(path.name for path in out.iterdir()) == ["file"]


def test_outputs_that_replace_each_other_or_a_file(maxcon, refused, drive, out, monkeypatch):
    monkeypatch.chdir(out)
    before = drive.dataset.prior.read_bytes()
    twice = ("--prior, --out, --tum and --report", "twice")
    refused(maxcon(*drive.localize, drive.dataset.prior), *twice)
    refused(maxcon(*drive.localize, out / "poses.txt", "--tum", out / "." / "poses.txt"), *twice)
    assert drive.dataset.prior.read_bytes() == before
    refused(maxcon(*drive.localize, "poses.csv", "--plot", "a" * 300), "too long")
    for name in (".", "..", "/"):
        for command in ((*drive.build, name, "--overwrite"), (*drive.localize, name), ("demo", "--out", name)):
            refused(maxcon(*command), name)
    assert list(out.iterdir()) == []
    (out / "file").touch()
    refused(maxcon(*drive.localize, "poses.csv", "--plot", out / "file"), "the file", out / "file")
    refused(maxcon(*drive.localize, "poses.csv", "--plot", out / "file" / "new"), out / "file" / "new")
    assert [path.name for path in out.iterdir()] == ["file"]


def test_names_with_line_ends_stay_in_one_line(maxcon, refused, tmp_path):
    for name in ("a\nb.laz", "a\r\x1b[31mb.npz", "\u2028.ply"):
        refused(maxcon("map", "build", tmp_path / name, "-o", tmp_path / "a.map"), "no such file")
        (tmp_path / name).write_bytes(b"x")
        refused(maxcon("map", "build", tmp_path / name, "-o", tmp_path / "a.map"), "Expected")
    assert one_line("a\nb\x1b \u00e4") == "a\\nb\\x1b \u00e4"


@pytest.mark.kills
@pytest.mark.parametrize("limit", [2_000, 1_000_000])
def test_the_disk_is_full_while_building(maxcon_in_process_of_its_own, refused, drive, out, limit):
    ended = maxcon_in_process_of_its_own(*drive.build, out / "city.map", preexec_fn=_small_disk(limit))
    refused(ended, out / "city.map", "free disk space", "nothing was written")
    assert list(out.iterdir()) == []


@pytest.fixture
def nothing_to_compile(maxcon_in_process_of_its_own, drive, tmp_path):
    """Compiled code is kept in files too: it must be there before the disk is full."""
    options = ("--plot", tmp_path / "warm", "--plot-epochs", "0")
    maxcon_in_process_of_its_own(*drive.localize, tmp_path / "warm.csv", *options)


@pytest.mark.kills
@pytest.mark.usefixtures("nothing_to_compile")
def test_the_disk_is_full_while_writing_poses(maxcon_in_process_of_its_own, refused, drive, out):
    (out / "poses.csv").write_text("the table of yesterday")
    arguments = (out / "poses.csv", "--overwrite")
    ended = maxcon_in_process_of_its_own(*drive.localize, *arguments, preexec_fn=_small_disk(100))
    refused(ended, out / "poses.csv", "File too large", "nothing was written")
    assert sorted(path.name for path in out.iterdir()) == ["poses.csv"]
    assert (out / "poses.csv").read_text() == "the table of yesterday"


@pytest.mark.kills
@pytest.mark.usefixtures("nothing_to_compile")
def test_the_disk_is_full_while_drawing(maxcon_in_process_of_its_own, refused, drive, out):
    arguments = (out / "poses.csv", "--plot", out / "pictures", "--plot-epochs", "0")
    ended = maxcon_in_process_of_its_own(*drive.localize, *arguments, preexec_fn=_small_disk(20_000))
    refused(ended, out / "pictures" / "000000.png", "File too large", "1 of 4 epochs are kept", "--resume")
    assert sorted(path.name for path in out.iterdir()) == ["pictures", "poses.csv"]
    assert list((out / "pictures").iterdir()) == []
    assert len((out / "poses.csv").read_text().splitlines()) == 2


@pytest.mark.kills
def test_the_disk_is_full_while_exporting(maxcon_in_process_of_its_own, refused, poses, drive, out):
    pytest.importorskip("pyogrio")
    export = ("export", poses, "-o", out / "a.gpkg", "--map", drive.city)
    ended = maxcon_in_process_of_its_own(*export, preexec_fn=_small_disk(40_000))
    refused(ended, out / "a.gpkg", "Is the disk full?")
    assert "INSERT" not in ended.err


@pytest.mark.kills
@pytest.mark.usefixtures("nothing_to_compile")
def test_the_disk_is_full_half_way(maxcon_in_process_of_its_own, maxcon, refused, drive, out):
    ended = maxcon_in_process_of_its_own(*drive.localize, out / "poses.csv", preexec_fn=_small_disk(1_500))
    refused(ended, out / "poses.csv", "File too large", "epochs are kept", "--resume")
    n_rows = int(ended.err.partition(" of 4 epochs")[0].rpartition(" ")[2])
    assert 0 < n_rows < 4
    lines = (out / "poses.csv").read_text().splitlines()
    assert len(lines) == 1 + n_rows and lines[-1].count(",") == lines[0].count(",")
    assert maxcon(*drive.localize, out / "poses.csv", "--resume").code == 0


def test_the_reader_of_the_output_goes_away(maxcon_process, drive):
    with maxcon_process("map", "info", drive.city) as process:
        process.stdout.close()
        err = process.stderr.read()
        process.wait(timeout=600)
    assert "Traceback" not in err
