# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon simulate --campaign`: what is passed on, what is printed, what is refused."""

from dataclasses import replace

import pytest

import maxcon.lab.simulation
from maxcon.lab.simulation import simulate_campaign


@pytest.fixture
def asked(monkeypatch, campaign, thin_scanner, thinnest_profiles):
    """What simulate_campaign is asked for; it writes one epoch and a thin map."""
    calls = []
    world = replace(campaign, mapping=replace(campaign.mapping, drives=campaign.mapping.drives[:1]))
    monkeypatch.setattr(maxcon.lab.simulation.CampaignWorld, "build", lambda *_, **__: world)

    def thinly(out, **options):
        calls.append({key: options[key] for key in ("n_epochs", "every", "seed", "is_hard", "overwrite")})
        options["n_epochs"] = 1
        return simulate_campaign(out, **options, mapping_scanners=thinnest_profiles, scanner=thin_scanner)

    monkeypatch.setattr(maxcon.lab.simulation, "simulate_campaign", thinly)
    return calls


def test_campaign_says_what_it_wrote(simulate_command, asked, tmp_path):
    code, printed = simulate_command(tmp_path / "out", "--campaign")
    assert (code, printed.err) == (0, "")
    assert asked == [{"n_epochs": 3001, "every": None, "seed": 0, "is_hard": False, "overwrite": False}]
    lines = printed.out.splitlines()
    assert lines[0] == str(tmp_path / "out")
    parts = {line[:13].strip(): line[13:].strip() for line in lines[1:]}
    assert list(parts) == ["map clouds", "mapping", "scans", "reference", "prior gnss", "prior uniform", "odometry"]
    assert parts["prior gnss"] == str(tmp_path / "out" / "prior_gnss.txt")
    assert parts["prior uniform"] == str(tmp_path / "out" / "prior_uniform.txt")


def test_hard_and_the_number_of_epochs_are_passed_on(simulate_command, asked, tmp_path):
    code, _ = simulate_command(
        tmp_path / "out", "--campaign", "--hard", "--epochs", "200", "--every", "0.5", "--seed", "4"
    )
    assert code == 0
    assert asked == [{"n_epochs": 200, "every": 0.5, "seed": 4, "is_hard": True, "overwrite": False}]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--hard",), "maxcon: Expected --hard together with --campaign, got it alone."),
        (("--every", "0.1"), "maxcon: Expected --every together with --campaign, got it alone."),
        (("--campaign", "--epochs", "3002"), "maxcon: Expected 1 to 3001 epochs of a campaign"),
    ],
)
def test_wrong_options_are_refused(simulate_command, tmp_path, options, words):
    code, printed = simulate_command(tmp_path / "out", *options)
    assert code == 2
    assert printed.err.startswith(words)
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
