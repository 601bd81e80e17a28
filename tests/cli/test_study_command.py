"""`maxcon study` and `maxcon report`: what they print, what they refuse, and that a kill loses nothing."""

import signal
from pathlib import Path

import pytest

from drawn_figures import undrawn
from maxcon.lab.study import Study
from maxcon.lab.study.table import keys_of, table_of
from watched_processes import all_ended

METHODS = ("--methods", "helmert-occupied,count-points,helmert-points-unweighted")
SMALL = ("--half-width", "1.2", "--heading-half-width-deg", "1")


@pytest.fixture
def described(drive, long_drive, tmp_path):
    """A description of the long drive with the map that is built already."""
    folder, _, reference = long_drive
    description = tmp_path / "drive.toml"
    description.write_text(
        f'[map]\npath = "{drive.city}"\n[scans]\nfolder = "{folder.name}"\nreference = "{reference.name}"\n'
        f'[priors]\nexact = "{reference.name}"\n'
    )
    return description


@pytest.mark.kills
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc: processes cannot be watched")
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_study_that_is_stopped_goes_on(described, stopped_when, maxcon, tmp_path, name):
    number, out, children = getattr(signal, name), tmp_path / "study", []
    arguments = ("study", described, "-o", out, *METHODS, *SMALL, "--workers", "2", "--quiet")

    def has_two_parts(process):
        children[:] = map(int, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split())
        return len(list(out.glob("parts/[!.]*.parquet"))) >= 2

    code, err = stopped_when(number, has_two_parts, *arguments)
    assert code == (-number if number == signal.SIGKILL else 128 + number)
    assert "Traceback" not in err and all_ended(children)
    assert not (out / "table.parquet").exists()
    before = table_of(out).read().to_pylist()
    assert 0 < len(before) < 120 and maxcon(*arguments).code == 0
    table = Study.open(out).table
    assert len(table) == len(set(keys_of(table))) == 120 and not (out / "parts").exists()
    after = {(row["method"], row["epoch"]): row for row in table.to_pylist()}
    assert all(after[row["method"], row["epoch"]] == row for row in before)  # times and all: not made again


def test_study_and_report_say_what_they_did(described, maxcon, tmp_path, monkeypatch):
    undrawn(monkeypatch)
    out, page, scan = tmp_path / "study", tmp_path / "page.html", tmp_path / "long" / "000000.bin"
    scan.unlink()
    scan.write_bytes(b"123")
    ended = maxcon("study", described, "-o", out, *METHODS, *SMALL, "--epochs", "3", "--workers", "1")
    assert (ended.code, ended.err) == (0, "")
    lines = ended.out.splitlines()
    assert lines[0] == "prior exact"
    assert [line.split()[:2] for line in lines[2:8:2]] == [
        ["helmert-occupied", "2/3"], ["count-points", "2/3"], ["helmert-points-unweighted", "2/3"],
    ]  # fmt: skip
    assert [line.strip() for line in lines[3:8:2]] == ["1 unreadable scan"] * 3
    assert lines[8:] == [f"9 rows in {out / 'table.parquet'}", f"page         maxcon report {out} -o report.html"]
    ended = maxcon("report", out, "-o", page)
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines() == [str(page), f"figures      {tmp_path / 'page-figures'}"]
    assert "helmert-points-unweighted" in page.read_text()


OWN = """
import numpy as np

class Determinant:
    title = "Root of det N"
    def score(self, moments):
        nxx, nxy, nyy = (moments[..., channel].astype(float) for channel in (1, 2, 3))
        return np.sqrt(np.maximum(0.0, nxx * nyy - nxy**2))


class Wrong:
    score = staticmethod(np.asarray)


class Edited(Determinant):
    pass


class Last:
    score = staticmethod(lambda moments: moments[..., 3] if moments.max() < 40 else moments["xx"])
"""


def test_an_objective_of_one_s_own_is_compared_with_ours_alike(described, maxcon, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_scores.py").write_text(OWN)
    word, out, page = "own_scores:Determinant", tmp_path / "study", tmp_path / "page.html"
    ended = maxcon("study", described, "-o", out, "--methods", word, *SMALL, "--epochs", "2", "--workers", "1")
    assert (ended.code, ended.err) == (0, "")
    names = ["Determinant-occupied", "count-occupied", "helmert-occupied", "max-eigenvalue-occupied"]
    assert [line.split()[:2] for line in ended.out.splitlines()[2:6]] == [[name, "2/2"] for name in names]
    assert ended.out.splitlines()[-1].endswith(f"-o report.html --objective {word}")
    mine, *ours = Study.open(out).configuration.methods.values()
    assert mine["method"]["objective"].pop("class") == "own_scores.Determinant"
    for each in (mine, *ours):
        del each["method"]["objective"]
    assert all(each == mine for each in ours)
    assert maxcon("report", out, "-o", page, "--objective", word).code == 0
    svg = [(tmp_path / f"page-figures/{name}.svg").read_text() for name in ("comparison", "distinctness-occupied")]
    assert "Root of det N" in svg[0] and "Determinant-occupied" in svg[1]
    text = page.read_text()
    assert "adjusted to the map" not in text and "The paper says" not in text  # for none of its methods was studied
    assert "Left: Root of det N of every position" in text and "edited since" not in text
    undrawn(monkeypatch)
    assert maxcon("report", out, "-o", page, "--objective", "own_scores:Edited").code == 0
    assert "it was not studied, or was edited since" in page.read_text()


def test_an_objective_that_fails_is_named_with_the_line(described, localize, maxcon, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "failing.py").write_text(OWN)
    bad = ("study", described, "-o", tmp_path / "bad", *SMALL, "--epochs", "1", "--methods")
    refused(maxcon(*bad, "failing:Wrong"), "Expected failing.Wrong to return scores of shape (1, 1, 2), got (1, 1, 2,")
    line = f"{tmp_path / 'failing.py'}, line {len(OWN.splitlines())}."
    refused(localize("--objective", "failing:Last"), "Expected failing.Last to score moments, got IndexError", line)
    assert not (tmp_path / "bad").exists() and not (tmp_path / "poses.csv").exists()
    refused(maxcon(*bad, "failing:Last"), "Expected failing.Last to score moments, got IndexError", line)
