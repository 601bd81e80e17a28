"""Every example runs as a script, is short, and prints what it should."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted({*FOLDER.glob("*.py")} - {*FOLDER.glob("*.launch.py")})  # those of ROS: tests/cli/test_live_node.py
MAX_LINES = 60

pytestmark = pytest.mark.documents


def _run(name, folder):
    """Lines that an example prints when it is started from another folder."""
    command = [sys.executable, "-W", "error", FOLDER / name]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=900)
    assert (ended.returncode, ended.stderr) == (0, "") and list(folder.iterdir()) == []
    return ended.stdout.splitlines()


def _numbers(line):
    return [float(text) for text in re.findall(r"-?\d+(?:\.\d+)?", line)]


def test_localize_one_scan(tmp_path):
    position, heading, prior = _run("localize_one_scan.py", tmp_path)
    assert position.startswith("localized: x ")
    x, y = _numbers(position)
    assert abs(x - 5.0) <= 0.06 and abs(y - 0.5) <= 0.06
    heading_deg, score = _numbers(heading)
    assert abs(heading_deg - 22.9) <= 0.5 and score > 10
    assert _numbers(prior) == [1.70]


def test_own_objective(tmp_path):
    lines = _run("own_objective.py", tmp_path)
    assert [line.split()[0] for line in lines] == ["Count", "Helmert", "Determinant"]
    for line in lines:
        x, y = _numbers(line)
        assert abs(x - 5.0) <= 0.06 and abs(y - 0.5) <= 0.06
        assert line.endswith(", localized")


def test_read_and_plot(tmp_path):
    *scans, pictures = _run("read_and_plot.py", tmp_path)
    for second, line in enumerate(scans):
        name, x = line.split(": localized, x ")
        assert name == f"{second}.0.npz" and abs(_numbers(x)[0] - (5.0 * second - 8.0)) <= 0.06
    assert len(scans) == 4 and pictures == "pictures: epoch.png poses.png"


def test_each_example_is_run_here_and_short():
    source = Path(__file__).read_text()
    assert EXAMPLES
    for example in EXAMPLES:
        assert f'_run("{example.name}", ' in source
        assert len(example.read_text().splitlines()) < MAX_LINES
