# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Without the optional packages: one line that says what to install, before any work is done."""

import pytest


@pytest.mark.parametrize(
    ("package", "command", "extra"),
    [
        ("embreex", ("demo", "--out", "OUT"), "demo"),
        ("matplotlib", ("demo", "--out", "OUT"), "demo"),
        ("jinja2", ("demo", "--out", "OUT"), "demo"),
        ("embreex", ("simulate", "OUT"), "demo"),
        ("matplotlib", ("localize", "MAP", "SCANS", "--prior", "PRIOR", "-o", "OUT", "--plot", "PICTURES"), "demo"),
        ("rerun", ("localize", "MAP", "SCANS", "--prior", "PRIOR", "-o", "OUT", "--view"), "view"),
        ("rerun", ("relocalize", "MAP", "SCANS", "-o", "OUT", "--save", "OUT.rrd"), "view"),
        ("rerun", ("export", "POSES", "-o", "OUT.rrd", "--map", "MAP"), "view"),
        ("distributed", ("localize", "MAP", "SCANS", "-o", "OUT", "--scheduler", "tcp://127.0.0.1:8786"), "engine"),
        ("cyclonedds", ("live", "MAP", "--ros2"), "ros2"),
        ("pyogrio", ("export", "POSES", "-o", "OUT.gpkg", "--map", "MAP"), "export"),
    ],
)
def test_what_is_not_installed_is_said_before_the_work(
    maxcon, refused, without, drive, poses, out, monkeypatch, package, command, extra
):
    monkeypatch.setattr("maxcon.lab.demo.simulate", None)
    without(package)
    files = {"MAP": drive.city, "SCANS": drive.dataset.scans, "PRIOR": drive.dataset.prior, "POSES": poses}
    files |= {name: out / name for name in ("OUT", "OUT.gpkg", "OUT.rrd", "PICTURES")}
    ended = maxcon(*(files.get(word, word) for word in command))
    refused(ended, package, f"pip install 'maxcon[{extra}]'")
    assert list(out.iterdir()) == []


def test_localizing_needs_no_extra(localize, without):
    without(
        "matplotlib", "embreex", "jinja2", "trimesh", "pypcd4", "rosbags", "mcap", "distributed", "pyogrio", "rerun"
    )
    assert localize("--workers", "1").code == 0
