"""What a study's table says of certainty, from small tables made by hand."""

import pytest

from drawn_figures import undrawn
from maxcon.lab.evaluation import ProtectionCounts
from maxcon.lab.report.study_figures import certainty_of
from study_tables import rows_of

ANSWER = {
    "status": "localized", "is_localized": True, "is_success": True, "x": 0.0, "reference_x": 0.0, "distance": 0.01,
    "along": 0.01, "across": -0.01, "height_error": 0.01, "heading_error": 0.001, "runner_up": 0.3,
}  # fmt: skip
SIGMAS = {"sigma_along": 0.02, "sigma_across": 0.005, "sigma_z": 0.02, "sigma_heading": 0.002, "nees": 4.25}
LEVELS = {"protection_along": 0.05, "protection_across": 0.008}
WITHHELD = ANSWER | {"status": "ambiguous", "is_localized": False}
UNREADABLE = {"status": "unreadable scan", "is_localized": False, "is_success": False, "reference_x": 0.0}
CONFIGURED = {"maxcon": {"method": {"class": "MaximumConsensus", "risk": 0.02}}}


@pytest.fixture(autouse=True)
def _undrawn(monkeypatch):
    undrawn(monkeypatch)


def by_prior(by_method, priors=("gnss",)):
    return {prior: rows_of(by_method, prior) for prior in priors}


def test_errors_are_held_to_sigmas_and_levels(tmp_path):
    sure = ANSWER | SIGMAS | LEVELS
    rows = by_prior({"maxcon": [sure] * 9 + [sure | {"across": 0.004}, WITHHELD, UNREADABLE]})
    found = certainty_of(tmp_path, rows, "gnss", CONFIGURED)
    coverage, protection = found["coverage"][0], found["protection"][0]
    assert {row["name"]: row["coverage"].n_within for row in coverage["rows"]} == {
        "along": (10, 10, 10), "across": (1, 10, 10), "height": (10, 10, 10), "heading": (10, 10, 10),
        "x and y": (0, 0, 10),
    }  # fmt: skip
    assert [row["verdict"] for row in coverage["rows"]] == [
        "too large", "too small", "too large", "too large", "too small"
    ]  # fmt: skip
    assert coverage["rows"][-1]["coverage"].rms ** 2 == pytest.approx(4.25)
    assert protection["counts"] == {
        "along": ProtectionCounts(10, 0, 0, 0, 1),
        "across": ProtectionCounts(1, 9, 0, 0, 1),
        "either": ProtectionCounts(1, 9, 0, 0, 1),
    }
    assert (protection["risk"], protection["n_to_prove"]) == (0.02, 149)
    assert {path.stem for path in tmp_path.iterdir()} == {"stanford", "timeline"}
    assert found["notes"] == []


@pytest.mark.parametrize(("method", "rows", "n_tables", "words"), [
    ("gicp-3m", [ANSWER, WITHHELD], 0, "no method predicts its errors here, with the prior “gnss”"),
    ("maxcon", [ANSWER | SIGMAS], 1, "No Stanford diagram: maxcon gives no protection levels."),
    ("maxcon", [UNREADABLE] * 2, 0, "no method predicts its errors here"),
])  # fmt: skip
def test_what_no_method_predicts_is_not_shown_and_the_page_says_so(tmp_path, method, rows, n_tables, words):
    found = certainty_of(tmp_path, by_prior({method: rows}), "gnss", CONFIGURED)
    assert (len(found["coverage"]), found["protection"], found["protection_pictures"]) == (n_tables, [], [])
    assert {path.stem for path in tmp_path.iterdir()} == {"timeline"}
    (note,) = found["notes"]
    assert words in note


def test_every_prior_has_its_tables_and_its_timeline(tmp_path):
    rows = by_prior({"maxcon": [ANSWER | SIGMAS | LEVELS] * 3}, ("gnss", "uniform", "reference"))
    found = certainty_of(tmp_path, rows, "uniform", CONFIGURED)
    assert len(found["coverage"]) == len(found["protection"]) == 3
    assert [picture.title.rpartition(" ")[2] for picture in found["status_pictures"]] == [
        "“uniform”", "“gnss”", "“reference”"
    ]  # fmt: skip
    assert {"timeline", "timeline-2", "timeline-3"} <= {path.stem for path in tmp_path.iterdir()}


def test_a_method_of_one_s_own_goes_first_and_states_no_risk(tmp_path):
    rows = by_prior({"maxcon": [ANSWER | SIGMAS | LEVELS], "mine": [ANSWER | SIGMAS | LEVELS]})
    found = certainty_of(tmp_path, rows, "gnss", CONFIGURED | {"mine": {"method": {"class": "Mine"}}})
    assert found["coverage"][0]["title"] == "Errors within predicted sigmas: mine, prior “gnss”"
    assert [found["protection"][0][name] for name in ("risk", "n_to_prove")] == [None, None]
