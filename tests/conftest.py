# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What all tests share: no time limit per example (loops are compiled at first use), and real data if present."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("maxcon", deadline=None)
settings.load_profile("maxcon")


@pytest.fixture(scope="session")
def shared_data():
    """The folder of real data: $MAXCON_DATA, or ../shared/data beside the repository."""
    folder = Path(os.environ.get("MAXCON_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}; set MAXCON_DATA")
    return folder
