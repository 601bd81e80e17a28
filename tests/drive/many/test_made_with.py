# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What drives are made with is written down, whatever one of them cannot be read from."""

from pathlib import Path

import pytest

from maxcon.drive.many import DriveEntry, PosesDataset
from maxcon.drive.many.made_with import check_sources

UNREADABLE = Path("/proc/self/mem")


@pytest.mark.skipif(not UNREADABLE.exists(), reason="no file here that is there and cannot be read")
def test_a_prior_that_cannot_be_read_keeps_no_other_drive_from_its_own(tmp_path):
    entries = [
        DriveEntry(name, tmp_path / "scans", tmp_path / "no.map", prior)
        for name, prior in (("broken", UNREADABLE), ("whole", None))
    ]
    check_sources(PosesDataset(tmp_path), entries)
    check_sources(PosesDataset(tmp_path), entries)
    assert '"broken"' in (tmp_path / "_drives.json").read_text()
