# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon simulate --scene suburb` and `--scanner`: what is passed on, what is printed, what is refused."""

import pytest

import maxcon.lab.simulation
from maxcon.lab.simulation import ScannerLayout, simulate_suburb


@pytest.fixture
def asked(monkeypatch, suburb, thinnest_profiles):
    """What simulate_suburb is asked for; it writes one epoch and a thin map."""
    calls = []
    monkeypatch.setattr(maxcon.lab.simulation.SuburbWorld, "build", lambda *_: suburb)

    def thinly(out, **options):
        calls.append({key: value for key, value in options.items() if key not in ("progress", "overwrite")})
        options["n_epochs"] = 1
        return simulate_suburb(out, **options, mapping_scanners=thinnest_profiles)

    monkeypatch.setattr(maxcon.lab.simulation, "simulate_suburb", thinly)
    return calls


def test_a_suburb_says_what_it_wrote(simulate_command, asked, tmp_path):
    code, printed = simulate_command(tmp_path / "out", "--scene", "suburb")
    assert (code, printed.err) == (0, "")
    assert asked == [{"n_epochs": 200, "seed": 0}]
    parts = {line[:13].strip(): line[13:].strip() for line in printed.out.splitlines()[1:]}
    assert list(parts) == ["map clouds", "mapping", "scans", "reference", "prior gnss", "prior uniform"]


def test_scanner_epochs_and_seed_are_passed_on(simulate_command, asked, tmp_path):
    options = ("--scanner", "vlp-32c", "--epochs", "600", "--seed", "4")
    code, _ = simulate_command(tmp_path / "out", "--scene", "suburb", *options)
    assert code == 0
    assert asked == [{"n_epochs": 600, "seed": 4, "scanner": ScannerLayout.VLP_32C.scanner()}]


@pytest.mark.parametrize("options", [(), ("--campaign",)])
def test_the_city_takes_a_scanner_too(simulate_command, monkeypatch, tmp_path, dataset, options):
    calls = []
    name = "simulate_campaign" if options else "simulate"
    monkeypatch.setattr(maxcon.lab.simulation, name, lambda out, **given: calls.append(given) or dataset)
    code, _ = simulate_command(tmp_path / "out", *options, "--scanner", "os1-64")
    assert code == 0
    assert calls[0]["scanner"] == ScannerLayout.OS1_64.scanner()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scene", "suburb", "--campaign"), "maxcon: Expected --campaign in the city, got it with --scene suburb."),
        (("--scene", "suburb", "--hard"), "maxcon: Expected --hard together with --campaign, got it alone."),
        (("--scene", "suburb", "--epochs", "602"), "maxcon: Expected 1 to 601 epochs of a suburb"),
        (("--scanner", "vlp16"), "maxcon: Expected `scanner` to be 'vlp-16', 'vlp-32c', 'hdl-64e' or 'os1-64'"),
    ],
)
def test_wrong_options_are_refused(simulate_command, tmp_path, options, words):
    code, printed = simulate_command(tmp_path / "out", *options)
    assert code == 2
    assert printed.err.startswith(words)
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
