# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What all tests share: no time limit per example (loops are compiled at first use), and real data if present."""

import os
from pathlib import Path

import pytest
from hypothesis import Phase, settings

settings.register_profile("maxcon", deadline=None)
# For a mutation test: the same examples for every mutant, and no time for making a failing one simple.
settings.register_profile(
    "mutation",
    deadline=None,
    derandomize=True,
    database=None,
    phases=(Phase.explicit, Phase.generate),
    report_multiple_bugs=False,
)
settings.load_profile("maxcon")


@pytest.fixture(scope="session")
def real_data():
    """Find a part of the real data, in $MAXCON_DATA or ../shared/data beside the repository; skip where it is not."""
    root = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "shared" / "data"))

    def find(part):
        if not (root / part).exists():
            pytest.skip(f"no real data at {root / part}; set MAXCON_DATA")
        return root / part

    return find
