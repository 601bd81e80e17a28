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
)
settings.load_profile("maxcon")


@pytest.fixture(scope="session")
def shared_data():
    """The folder of real data: $MAXCON_DATA, or ../shared/data beside the repository."""
    folder = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}; set MAXCON_DATA")
    return folder
