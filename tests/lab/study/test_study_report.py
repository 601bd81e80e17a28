"""The page of a study as `maxcon report` writes it and a browser shows it; what it says of certainty; its epochs."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import maxcon
from maxcon._system.resumable import describe
from maxcon.errors import FileError, OptionError
from maxcon.lab.evaluation import ProtectionCounts
from maxcon.lab.report.facings import facings
from maxcon.lab.report.study_certainty import certainty_of
from maxcon.lab.report.study_pictures import draw_scenes, pick_epochs, space_of
from maxcon.lab.report.study_report import report_study
from maxcon.lab.study.table import table_of
from maxcon.search.space import SearchSpace
from opened_pages import assert_whole
from study_tables import rows_of

FIGURES = {
    "scene", "headings", "comparison", "distinctness-points", "kurtosis-points", "success", "errors",
    "risk-coverage", "timeline",
}  # fmt: skip


@pytest.fixture(scope="module")
def page_file(study, tmp_path_factory):
    page = tmp_path_factory.mktemp("page") / "report.html"
    folder = report_study(study.folder, page)
    assert {path.stem for path in folder.glob("*.svg")} == FIGURES
    return page


def test_the_page_has_every_claim_method_and_figure(page_file, methods):
    text = page_file.read_text()
    assert text.count('<td class="verdict') == 8
    for method in methods:
        assert f">{method.name}</th>" in text
    assert "no method predicts its errors here, with the prior “uniform”" in text
    assert text.count("data:image/svg+xml") == len(FIGURES)
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    assert "://" not in re.sub(r"data:[^\"]*", "", text)


@pytest.mark.browser
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "light"), (1280, "dark")])
def test_a_browser_shows_it_whole(page_file, width, scheme):
    assert_whole(page_file, width, scheme, len(FIGURES))


def test_a_method_that_predicts_its_errors_is_held_to_it(copied, tried, tmp_path):
    sorted(copied.scans.glob("*.bin"))[1].write_bytes(b"123")
    study = tried(["maxcon", "count-points", "helmert-points"])
    folder = report_study(study.folder, tmp_path / "page.html")
    assert {path.stem for path in folder.iterdir()} == FIGURES | {"sigmas", "stanford"}
    text = (tmp_path / "page.html").read_text()
    for words in (
        "Errors within predicted sigmas: maxcon, prior “uniform”",
        "To prove that takes 299 independent epochs without a single one beyond its level; this study has 5.",
        "unreadable scan, such as: Expected float32",
        "5 of 5 (100.0 %) epochs within 0.3 m and 1° (1 more could not be tried)",
    ):
        assert words in text, words
    assert "no method predicts its errors" not in text


def test_a_moved_or_changed_dataset_leaves_the_scenes_out_and_says_so(copied, tried, tmp_path):
    study = tried(["count-points", "helmert-points"], n_epochs=3)
    copied.folder.rename(tmp_path / "moved")
    folder = report_study(study.folder, tmp_path / "gone.html", figures=tmp_path / "pictures")
    assert folder == tmp_path / "pictures"
    assert {path.stem for path in folder.iterdir()} == FIGURES - {"scene", "headings", "comparison"}
    assert "No scenes: Expected a dataset" in (tmp_path / "gone.html").read_text()
    report_study(study.folder, tmp_path / "found.html", dataset=tmp_path / "moved")
    assert {path.stem for path in (tmp_path / "found-figures").iterdir()} == FIGURES
    text = (tmp_path / "found.html").read_text()
    assert "No scenes" not in text and "Some methods have 3 epochs only" in text
    description = tmp_path / "moved" / "dataset.toml"
    description.write_text(description.read_text().replace("uniform =", "other ="))
    for dataset, words in ((tmp_path / "nowhere", "Expected a dataset"), (description, "the prior uniform in")):
        with pytest.raises(FileError, match=words):
            report_study(study.folder, tmp_path / "no.html", dataset=dataset)
    assert not (tmp_path / "no.html").exists()


def test_methods_without_common_epochs_still_make_a_page(tried, tmp_path):
    study = tried(["count-points", "helmert-points"], n_epochs=2)
    table = table_of(study.folder)
    kept = [row for row in table.read().to_pylist() if (row["method"] == "count-points") == (row["epoch"] == 0)]
    table.path.unlink()
    table.add(kept)
    report_study(study.folder, tmp_path / "page.html")
    assert "No scenes: no epoch where both" in (tmp_path / "page.html").read_text()


def test_rows_without_an_answer_are_told(copied, tried, tmp_path):
    for scan in copied.scans.glob("*.bin"):
        scan.write_bytes(b"")
    study = tried(["count-points", "helmert-points"])
    report_study(study.folder, tmp_path / "bad.html")
    text = (tmp_path / "bad.html").read_text()
    assert "12: unreadable scan, such as: Expected float32" in text
    assert "0 of 6" in text


def test_what_cannot_be_reported_is_said(study, tmp_path):
    with pytest.raises(FileError, match="Expected a study in"):
        report_study(tmp_path, tmp_path / "report.html")
    with pytest.raises(OptionError, match="Expected a prior of the study, uniform, got 'gnss'"):
        report_study(study.folder, tmp_path / "report.html", prior="gnss")
    with pytest.raises(OptionError, match=r"to end in \.html, got .*page\.pdf"):
        report_study(study.folder, tmp_path / "page.pdf")
    with pytest.raises(FileError, match="Expected to be able to write"):
        report_study(study.folder, tmp_path / "no" / "report.html")
    (tmp_path / "study.json").write_bytes((study.folder / "study.json").read_bytes())
    with pytest.raises(OptionError, match="Expected rows in the study"):
        report_study(tmp_path, tmp_path / "report.html")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.json"]


def test_without_the_count_there_are_no_scenes_and_the_note_says_why(tmp_path):
    notes = []
    scenes = SimpleNamespace(method=SimpleNamespace(multiplicity="occupied"))
    assert draw_scenes(tmp_path, scenes, {"helmert-occupied": None}, notes) == []
    assert notes == ["No scenes: count-occupied and helmert-occupied not studied."]


ANSWER = {
    "status": "localized", "is_localized": True, "is_success": True, "x": 0.0, "reference_x": 0.0, "distance": 0.01,
    "along": 0.01, "across": -0.01, "height_error": 0.01, "heading_error": 0.001, "runner_up": 0.3,
}  # fmt: skip
SIGMAS = {"sigma_along": 0.02, "sigma_across": 0.005, "sigma_z": 0.02, "sigma_heading": 0.002, "nees": 4.25}
LEVELS = {"protection_along": 0.05, "protection_across": 0.008}
WITHHELD = ANSWER | {"status": "ambiguous", "is_localized": False}
UNREADABLE = {"status": "unreadable scan", "is_localized": False, "is_success": False, "reference_x": 0.0}
CONFIGURED = {"maxcon": {"method": {"class": "MaximumConsensus", "risk": 0.02}}}


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
    assert coverage["squares"].mean == pytest.approx(4.25 / 2.0)
    assert protection["counts"] == {
        "along": ProtectionCounts(10, 0, 0, 0, 1),
        "across": ProtectionCounts(1, 9, 0, 0, 1),
        "either": ProtectionCounts(1, 9, 0, 0, 1),
    }
    assert (protection["risk"], protection["n_to_prove"]) == (0.02, 149)
    assert {path.stem for path in tmp_path.iterdir()} == {"sigmas", "stanford", "risk-coverage", "timeline"}
    assert found["notes"] == []


def test_baselines_alone_are_shown_without_sigmas_and_the_page_says_so(tmp_path):
    found = certainty_of(tmp_path, by_prior({"gicp-3m": [ANSWER, WITHHELD]}), "gnss", {})
    assert [found[name] for name in ("coverage", "protection", "coverage_pictures", "protection_pictures")] == [[]] * 4
    assert {path.stem for path in tmp_path.iterdir()} == {"risk-coverage", "timeline"}
    assert "no method predicts its errors here, with the prior “gnss”" in found["notes"][0]


def test_sigmas_without_levels_have_no_stanford_diagram(tmp_path):
    found = certainty_of(tmp_path, by_prior({"maxcon": [ANSWER | SIGMAS]}), "gnss", CONFIGURED)
    assert len(found["coverage"]) == 1 and found["protection"] == []
    assert {path.stem for path in tmp_path.iterdir()} == {"sigmas", "risk-coverage", "timeline"}
    assert found["notes"] == ["No Stanford diagram: maxcon gives no protection levels."]


def test_every_prior_has_its_tables_and_its_timeline(tmp_path):
    rows = by_prior({"maxcon": [ANSWER | SIGMAS | LEVELS] * 3}, ("gnss", "uniform", "reference"))
    found = certainty_of(tmp_path, rows, "uniform", CONFIGURED)
    assert len(found["coverage"]) == len(found["protection"]) == 3
    assert [picture.title.rpartition(" ")[2] for picture in found["status_pictures"][1:]] == [
        "“uniform”", "“gnss”", "“reference”"
    ]  # fmt: skip
    assert {"timeline", "timeline-2", "timeline-3"} <= {path.stem for path in tmp_path.iterdir()}


def test_a_method_of_one_s_own_goes_first_and_states_no_risk(tmp_path):
    rows = by_prior({"maxcon": [ANSWER | SIGMAS | LEVELS], "mine": [ANSWER | SIGMAS | LEVELS]})
    found = certainty_of(tmp_path, rows, "gnss", CONFIGURED | {"mine": {"method": {"class": "Mine"}}})
    assert found["coverage"][0]["title"] == "Errors within predicted sigmas: mine, prior “gnss”"
    assert [found["protection"][0][name] for name in ("risk", "n_to_prove")] == [None, None]


def test_epochs_that_say_nothing_leave_a_page(tmp_path):
    found = certainty_of(tmp_path, by_prior({"maxcon": [UNREADABLE] * 2}), "gnss", CONFIGURED)
    assert {path.stem for path in tmp_path.iterdir()} == {"timeline"}
    assert len(found["notes"]) == 1


def walls(off):
    """Points on two walls, normals at 15 and at 105 degrees from +x, the second off along that by so much; normals."""
    rng, turn = np.random.default_rng(0), np.radians(15.0)
    flat = np.column_stack([rng.uniform(-8.0, 8.0, 40_000), rng.uniform(0.0, 4.0, 40_000)])
    first = np.column_stack([np.full(40_000, 10.0), flat])
    second = np.column_stack([flat[:, 0], np.full(40_000, -6.0 + off), flat[:, 1]])
    normals = np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 40_000, axis=0)
    axes = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([first, second]) @ axes.T, normals @ axes.T


def test_a_wall_that_is_off_is_shown_in_its_direction():
    point_map = maxcon.PointMap.from_points(*walls(0.04))
    points, normals = (part[::20] for part in walls(0.0))
    pose = maxcon.Pose(1.0, 0.5, 1.8, 0.0, 0.0, 0.7)
    scan = maxcon.Scan(pose.inverse.apply(points), normals @ pose.rotation)
    first, second = facings([(scan, pose), (scan, pose)], point_map)
    assert (first.first_deg, first.last_deg, second.first_deg, second.last_deg) == (0.0, 30.0, 90.0, 120.0)
    assert min(first.n_points, second.n_points) > 800 and min(first.found, second.found) > 0.95
    assert (first.offset, second.offset) == (pytest.approx(0.0, abs=0.004), pytest.approx(0.04, abs=0.004))
    assert second.p95 < 0.06
    assert facings([], maxcon.PointMap.from_points(*walls(0.0))) == []


GOOD = {"is_success": True, "distance": 0.05, "kurtosis": 2.0}
LOST = {"is_success": False, "distance": 2.96, "kurtosis": 30.0}


def picked(*count, helmert=GOOD):
    """Epochs picked where the count has these rows, and Helmert's score the same row in each epoch."""
    rows = rows_of({"count": count, "helmert": [helmert] * len(count)})
    return pick_epochs(rows["count"], rows["helmert"])


def test_pictures_show_the_most_distinct_and_the_worst_epoch_within_the_search_space():
    epochs = picked(GOOD, GOOD | {"kurtosis": 7.0}, GOOD | {"kurtosis": 1.8}, LOST)
    assert epochs == {"crossing": 1, "street": 2, "count fails": 3}
    epochs = picked(GOOD, GOOD | {"kurtosis": 1.8})
    assert epochs == {"crossing": 0, "street": 1}
    epochs = picked(GOOD | {"kurtosis": 9.0, "prior_distance": 2.9}, GOOD | {"prior_distance": 1.0})
    assert epochs == {"crossing": 1, "street": 1}
    assert picked(LOST, helmert=LOST) == {}


def test_the_search_space_is_read_from_the_configuration():
    space = SearchSpace(1.2, 0.12, 1.0, 0.25)
    assert space_of({"mine": {"method": {"class": "Mine", "space": describe(space)}}}, "mine") == space
    assert space_of({}, "mine") is None
