# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""study.json as another program may have left it: refused in a line, wherever a name or a number is none."""

import json

import pytest

from maxcon.errors import FileError
from maxcon.lab.study.configuration import CONFIGURATION, Configuration

WHOLE = {
    "version": "1",
    "dataset": "dataset.toml",
    "parts": {"reference": "ab"},
    "n_scans": 3,
    "options": {"min_range": 1.0},
    "methods": {"helmert": {"method": {}, "map": "standard", "starts": "from the prior"}},
    "maps": {"standard": {}},
    "runs": [{"methods": ["helmert"], "priors": ["gnss"], "n_epochs": 3, "n_workers": 1, "n_rows": 3}],
}


def read(folder, **changes):
    (folder / CONFIGURATION).write_text(json.dumps({**WHOLE, **changes}))
    return Configuration.read(folder)


def test_what_is_written_is_read(tmp_path):
    assert read(tmp_path).runs[0]["priors"] == ["gnss"]


@pytest.mark.parametrize(
    "changes",
    [
        {"version": 1},
        {"dataset": 5},
        {"parts": {"reference": 5}},
        {"parts": []},
        {"n_scans": "3"},
        {"options": {"min_range": "near"}},
        {"methods": ["helmert"]},
        {"methods": {"helmert": 7}},
        {"maps": 7},
        {"runs": [7]},
        {"runs": 7},
        {"runs": [{"priors": [3]}]},
        {"runs": [{"priors": 3}]},
        {"runs": [{"methods": [3]}]},
        {"runs": [{"seconds": "long"}]},
    ],
    ids=str,
)
def test_a_number_for_a_name(tmp_path, changes):
    with pytest.raises(FileError, match=r"Expected a study in .*study\.json, got"):
        read(tmp_path, **changes)
