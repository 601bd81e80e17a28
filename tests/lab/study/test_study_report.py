"""The page of a study, as `maxcon report` writes it and as a browser shows it."""

import re
from types import SimpleNamespace

import pytest

from drawn_figures import undrawn
from maxcon.errors import FileError, OptionError
from maxcon.lab.report.study_report import report_study
from maxcon.lab.report.study_scenes import draw_scenes
from maxcon.lab.study.table import table_of
from opened_pages import assert_whole

FIGURES = {
    "headings", "comparison", "distinctness-points", "kurtosis-points", "success", "errors",
    "timeline",
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


def test_predicted_errors_are_held_to_and_a_moved_dataset_leaves_scenes_out(copied, tried, tmp_path, monkeypatch):
    sorted(copied.scans.glob("*.bin"))[2].write_bytes(b"123")
    study = tried(["maxcon", "count-points", "helmert-points"], n_epochs=3)
    copied.folder.rename(tmp_path / "moved")
    folder = report_study(study.folder, tmp_path / "gone.html", figures=tmp_path / "pictures")
    assert folder == tmp_path / "pictures"
    assert {path.stem for path in folder.iterdir()} == (FIGURES | {"stanford"}) - {"headings", "comparison"}
    assert "No scenes: Expected a dataset" in (tmp_path / "gone.html").read_text()
    undrawn(monkeypatch)
    report_study(study.folder, tmp_path / "found.html", dataset=tmp_path / "moved")
    assert {path.stem for path in (tmp_path / "found-figures").iterdir()} == FIGURES | {"stanford"}
    text = (tmp_path / "found.html").read_text()
    for words in (
        "Errors within predicted sigmas: maxcon, prior “uniform”",
        "To prove that takes 299 independent epochs without a single one beyond its level; this study has 2.",
        "unreadable scan, such as: Expected float32",
        "2 of 2 (100.0 %) epochs within 0.3 m and 1° (1 more could not be tried)",
        "Some methods have 3 epochs only",
    ):
        assert words in text, words
    assert "no method predicts its errors" not in text and "No scenes" not in text
    description = tmp_path / "moved" / "dataset.toml"
    description.write_text(description.read_text().replace("uniform =", "other ="))
    for dataset, words in ((tmp_path / "nowhere", "Expected a dataset"), (description, "the prior uniform in")):
        with pytest.raises(FileError, match=words):
            report_study(study.folder, tmp_path / "no.html", dataset=dataset)
    assert not (tmp_path / "no.html").exists()


def test_methods_without_common_epochs_still_make_a_page(tried, tmp_path, monkeypatch):
    undrawn(monkeypatch)
    study = tried(["count-points", "helmert-points"], n_epochs=2)
    table = table_of(study.folder)
    kept = [row for row in table.read().to_pylist() if (row["method"] == "count-points") == (row["epoch"] == 0)]
    table.path.unlink()
    table.add(kept)
    report_study(study.folder, tmp_path / "page.html")
    assert "No scenes: no epoch where both" in (tmp_path / "page.html").read_text()


def test_rows_without_an_answer_are_told(copied, tried, tmp_path, monkeypatch):
    undrawn(monkeypatch)
    for scan in copied.scans.glob("*.bin"):
        scan.write_bytes(b"")
    study = tried(["count-points", "helmert-points"])
    report_study(study.folder, tmp_path / "bad.html")
    text = (tmp_path / "bad.html").read_text()
    assert "12: unreadable scan, such as: Expected float32" in text and "0 of 6" in text


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
