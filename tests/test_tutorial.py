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


def test_the_tutorial_goes_to_its_end_and_shows_what_was_printed(tmp_path):
    commands, folder, printed = tmp_path / "bin", tmp_path / "tutorial", []
    commands.mkdir(), folder.mkdir()
    (commands / "maxcon").write_text(SCRIPT)
    (commands / "maxcon").chmod(0o755)
    environment = os.environ | {"PATH": os.pathsep.join([str(commands), os.environ["PATH"]])}
    blocks = FENCE.findall(PAGE.read_text())
    for language, body in blocks:
        if language not in ("sh", "python") or body.startswith("pip install"):
            continue
        words = ["sh", "-euc", body] if language == "sh" else [sys.executable, "-W", "error", "-c", body]
        ended = subprocess.run(words, capture_output=True, text=True, cwd=folder, env=environment, timeout=900)
        assert ended.returncode == 0, f"{body}\n{ended.stderr}"
        printed.append(ended.stdout)
    assert (folder / "poses.png").stat().st_size > 20_000
    assert len(json.loads((folder / "poses.geojson").read_text())["features"]) == 12
    assert len((folder / "poses.tum").read_text().splitlines()) >= 12
    assert printed[-1] == "12 poses, all within 10 cm: True\n"
    lines = [" ".join(line.split()) for text in printed for line in text.splitlines()]
    plain = {re.sub(r"median \d+ ms", "median N ms", line) for line in lines}
    shown = [" ".join(line.split()) for language, text in blocks if not language for line in text.splitlines() if line]
    assert [line for line in shown if re.sub(r"median \d+ ms", "median N ms", line) not in plain] == []
