"""The paper's claims against small tables made by hand."""

from maxcon.lab.report.claims import Verdict, paper_claims
from study_tables import rows_of

PLAIN = {
    "is_success": True, "is_localized": True, "status": "localized", "x": 0.0, "reference_x": 0.0, "distance": 0.05,
}  # fmt: skip
HELMERT = PLAIN | {"peak_ratio": 0.2, "kurtosis": 9.0, "divergence": 5.0, "spread": 0.06}
COUNT = PLAIN | {"peak_ratio": 0.9, "kurtosis": 2.0, "divergence": 25.0, "spread": 2.0}
ICP = PLAIN | {"distance": 0.01}
STARTS = PLAIN | {"n_starts": 25, "n_converged": 25}


def methods(**by_method):
    return rows_of({name.replace("_", "-"): rows for name, rows in by_method.items()})


def verdicts(**by_method):
    return [claim.verdict for claim in paper_claims(methods(**by_method), 0.06)]


def test_a_study_like_the_paper_agrees():
    lost = COUNT | {"is_success": False, "distance": 2.96}
    unlucky = STARTS | {"is_success": False, "n_converged": 24}
    found = paper_claims(
        methods(
            helmert_points=[HELMERT] * 4,
            count_points=[COUNT] * 3 + [lost],
            icp_plane_1m=[ICP] * 4,
            icp_plane_1m_5x5=[STARTS] * 3 + [unlucky],
        ),
        0.06,
    )
    assert [claim.verdict for claim in found] == [Verdict.AGREES] * 8
    assert found[0].study == "4 of 4 (100.0 %) epochs within 0.3 m and 1°."
    assert "1 of 4 (25.0 %) epochs, by up to 2.96 m" in found[1].study
    assert "icp-plane-1m-5x5: fails in 1 of 4 (25.0 %)" in found[2].study
    assert "median kurtosis of Helmert's score 9, of the count 2;" in found[4].study
    assert "only neighbours in 4 of 4 (100.0 %) epochs" in found[6].study
    words = "Where both succeed (4 epochs), median error of icp-plane-1m 0.010 m, of helmert-points 0.050 m."
    assert found[7].study == words


def test_a_study_unlike_the_paper_differs():
    lost = COUNT | {"is_success": False, "distance": 1.0}
    found = verdicts(
        helmert_points=[lost, COUNT],
        count_points=[HELMERT] * 2,
        icp_plane_1m=[ICP | {"distance": 0.2}] * 2,
        icp_plane_1m_5x5=[STARTS] * 2,
    )
    assert found[:3] == [Verdict.DIFFERS] * 3 and found[7] is Verdict.DIFFERS


def test_epochs_that_say_nothing_are_left_out():
    """Neither a scan that cannot be read nor an epoch without a reference is a failure of a method."""
    bad = {"status": "unreadable scan", "is_success": False, "is_localized": False, "reference_x": 0.0}
    lost = {"status": "localized", "is_success": None, "is_localized": True, "x": 0.0}
    rows = {
        "helmert_points": [HELMERT, bad, lost],
        "count_points": [COUNT, bad, lost],
        "icp_plane_1m_5x5": [STARTS, bad, lost],
    }
    found = paper_claims(methods(**rows), 0.06)
    assert [claim.verdict for claim in found[:3]] == [Verdict.AGREES, Verdict.DIFFERS, Verdict.DIFFERS]
    assert found[0].study == "1 of 1 (100.0 %) epochs within 0.3 m and 1° (2 more could not be tried)."
    assert "by up to" not in found[1].study
    found = verdicts(helmert_points=[bad], count_points=[bad], icp_plane_1m_5x5=[bad])
    assert set(found) == {Verdict.NOT_STUDIED}


def test_measures_along_the_ray_are_taken_around_the_reference_where_they_can():
    around_prior = methods(helmert_points=[COUNT] * 2, count_points=[HELMERT] * 2)
    centred = methods(helmert_points=[HELMERT] * 2, count_points=[COUNT] * 2)
    found = paper_claims(around_prior, 0.06, centred)
    assert [found[k].verdict for k in (3, 4, 5)] == [Verdict.DIFFERS, Verdict.AGREES, Verdict.AGREES]
    assert found[4].study.startswith("Around the reference, ")
    assert paper_claims(around_prior, 0.06)[4].study.startswith("Around this prior, ")


def test_icp_is_compared_where_it_is_right():
    lost = ICP | {"distance": 2.0, "is_success": False}
    found = paper_claims(methods(helmert_points=[HELMERT] * 5, icp_plane_1m=[lost] * 3 + [ICP] * 2), 0.06)
    assert found[7].verdict is Verdict.AGREES and "(2 epochs)" in found[7].study
