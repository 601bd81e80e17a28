# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The demo as its user starts it."""

import os
import subprocess
import sys

import pytest


@pytest.fixture(scope="session")
def run_demo():
    """Run `maxcon demo` in a process of its own."""

    def run(*arguments):
        command = [sys.executable, "-c", "from maxcon.cli import main; main()", "demo", *map(str, arguments)]
        environment = {**os.environ, "COLUMNS": "120"}
        return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=900)

    return run
