# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What all tests share: examples per property, real data if present, and folders that are built once per run."""

import os
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import Phase, settings

# No time limit per example: loops are compiled at first use.
settings.register_profile("maxcon", deadline=None, max_examples=30)
settings.register_profile("full", deadline=None, max_examples=100)
# For a mutation test: the same examples for every mutant, and no time for making a failing one simple.
settings.register_profile(
    "mutation", deadline=None, derandomize=True, database=None, phases=(Phase.explicit, Phase.generate),
    report_multiple_bugs=False,
)  # fmt: skip
settings.load_profile("full" if os.environ.get("CI") else "maxcon")


@pytest.fixture(scope="session")
def real_data():
    """Find a part of the real data, in $MAXCON_DATA or ../shared/data beside the repository; skip where it is not."""
    root = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "shared" / "data"))

    def find(part):
        if not (root / part).exists():
            pytest.skip(f"no real data at {root / part}; set MAXCON_DATA")
        return root / part

    return find


@pytest.fixture(scope="session")
def built_once(tmp_path_factory):
    """Build a folder once per run, not once per worker: `built_once(name, make)` calls `make(folder)` if it is new."""
    base = tmp_path_factory.getbasetemp()
    root = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def build(name, make):
        folder, done = root / name, root / f"{name}.done"
        with FileLock(root / f"{name}.lock"):
            if not done.exists():
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return build
