"""The tutorial is done from its first command to its picture, in a shell, as a reader would."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SCRIPT = f'#!/bin/sh\nexec {sys.executable} -c "from maxcon.cli import main; main()" "$@"\n'

pytest.importorskip("rosbags", reason="the extra recordings is not installed")
pytest.importorskip("embreex", reason="the extra demo is not installed")
pytestmark = [
    pytest.mark.documents,
    pytest.mark.skipif(sys.platform == "win32", reason="its commands are those of a shell of Unix"),
]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder a reader has in the end, and what was printed on the way, block by block."""
    commands = tmp_path_factory.mktemp("bin")
    (commands / "maxcon").write_text(SCRIPT)
    (commands / "maxcon").chmod(0o755)
    folder = tmp_path_factory.mktemp("tutorial")
    path = os.pathsep.join([str(commands), os.environ["PATH"]])
    printed = []
    for language, body in FENCE.findall(PAGE.read_text()):
        if language not in ("sh", "python") or body.startswith("pip install"):
            continue
        words = ["sh", "-euc", body] if language == "sh" else [sys.executable, "-W", "error", "-c", body]
        ended = subprocess.run(
            words, capture_output=True, text=True, cwd=folder, env={**os.environ, "PATH": path}, timeout=900
        )
        assert ended.returncode == 0, f"{body}\n{ended.stderr}"
        printed.append(ended.stdout)
    return folder, printed


def _shown():
    """What the page shows as printed."""
    return [body for language, body in FENCE.findall(PAGE.read_text()) if not language]


def test_the_tutorial_goes_to_its_end_and_shows_what_was_printed(done):
    folder, printed = done
    assert (folder / "poses.png").stat().st_size > 20_000
    assert len(json.loads((folder / "poses.geojson").read_text())["features"]) == 12
    assert len((folder / "poses.tum").read_text().splitlines()) >= 12
    assert printed[-1] == "12 poses, all within 10 cm: True\n"
    lines = [" ".join(line.split()) for text in printed for line in text.splitlines()]
    plain = {re.sub(r"median \d+ ms", "median N ms", line) for line in lines}
    shown = [" ".join(line.split()) for text in _shown() for line in text.splitlines() if line]
    assert [line for line in shown if re.sub(r"median \d+ ms", "median N ms", line) not in plain] == []
