# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page of a study, as `maxcon report` writes it and as a browser shows it."""

import re
import shutil

import pytest

from maxcon.errors import FileError, OptionError
from maxcon.lab.report.study_report import report_study
from maxcon.lab.study import choose_methods, run_study
from maxcon.lab.study.table import table_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "light"), (1280, "dark")])
def test_a_browser_shows_it_whole(page_file, width, scheme):
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: the page is not opened")
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: the page is not opened")
    with playwright.sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        said, asked = [], []
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(page_file.as_uri())
        n_images = page.evaluate("document.images.length")
        broken = page.evaluate("[...document.images].filter(i => !i.complete || i.naturalWidth < 100).length")
        overflow = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        rows = page.evaluate("document.querySelectorAll('table.methods tbody tr').length")
        browser.close()
    assert (said, broken, overflow) == ([], 0, 0)
    assert n_images == len(FIGURES)
    assert rows == 5 + 3  # all methods, and how distinct those of maximum consensus are
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []


def test_a_method_that_predicts_its_errors_is_held_to_it(copied, small_space, tmp_path):
    run_study(copied, tmp_path / "study", choose_methods(["maxcon", "icp-plane-1m"], small_space), n_workers=1)
    folder = report_study(tmp_path / "study", tmp_path / "page.html")
    assert {"sigmas", "stanford", "risk-coverage", "timeline"} <= {path.stem for path in folder.iterdir()}
    text = (tmp_path / "page.html").read_text()
    assert "maxcon 6 of 6" in text
    assert "Errors within predicted sigmas: maxcon, prior “uniform”" in text
    assert "To prove that takes 299 independent epochs without a single one beyond its level; this study has 6." in text
    assert "no method predicts its errors" not in text


def test_a_moved_dataset_leaves_the_scenes_out_and_says_so(copied, small_space, tmp_path):
    names = ["count-points", "helmert-points"]
    run_study(copied, tmp_path / "study", choose_methods(names, small_space), n_epochs=3, n_workers=1)
    copied.folder.rename(tmp_path / "moved")
    folder = report_study(tmp_path / "study", tmp_path / "gone.html", figures=tmp_path / "pictures")
    assert folder == tmp_path / "pictures"
    assert {path.stem for path in folder.iterdir()} == FIGURES - {"scene", "headings", "comparison"}
    assert "No scenes: Expected a dataset" in (tmp_path / "gone.html").read_text()
    report_study(tmp_path / "study", tmp_path / "found.html", dataset=tmp_path / "moved")
    assert {path.stem for path in (tmp_path / "found-figures").iterdir()} == FIGURES
    assert "No scenes" not in (tmp_path / "found.html").read_text()
    with pytest.raises(FileError, match="Expected a dataset"):
        report_study(tmp_path / "study", tmp_path / "no.html", dataset=tmp_path / "nowhere")
    assert not (tmp_path / "no.html").exists()
    assert "Some methods have 3 epochs only" in (tmp_path / "found.html").read_text()


def test_a_bad_epoch_leaves_the_page_whole(copied, small_space, tmp_path):
    scans = sorted(copied.scans.glob("*.bin"))
    names = ["count-points", "helmert-points"]
    scans[1].write_bytes(b"123")
    run_study(copied, tmp_path / "study", choose_methods(names, small_space), n_workers=1)
    folder = report_study(tmp_path / "study", tmp_path / "page.html")
    assert {path.stem for path in folder.iterdir()} == FIGURES
    text = (tmp_path / "page.html").read_text()
    assert "2: unreadable scan, such as: Expected float32" in text
    assert "5 of 5 (100.0 %) epochs within 0.3 m and 1° (1 more could not be tried)" in text


def test_a_dataset_that_was_changed_gives_no_scenes(copied, small_space, tmp_path):
    names = ["count-points", "helmert-points"]
    run_study(copied, tmp_path / "study", choose_methods(names, small_space), n_epochs=2, n_workers=1)
    copied.path.write_text(copied.path.read_text().replace("uniform =", "other ="))
    report_study(tmp_path / "study", tmp_path / "page.html")
    assert "No scenes: Expected the prior uniform in" in (tmp_path / "page.html").read_text()
    with pytest.raises(FileError, match="Expected the prior uniform in"):
        report_study(tmp_path / "study", tmp_path / "page.html", dataset=copied.path)


def test_methods_without_common_epochs_still_make_a_page(copied, small_space, tmp_path):
    first, second = (choose_methods([name], small_space) for name in ("count-points", "helmert-points"))
    run_study(copied, tmp_path / "study", first, n_epochs=1, n_workers=1)
    run_study(copied, tmp_path / "study", second, n_epochs=2, n_workers=1)
    table = table_of(tmp_path / "study")
    kept = [row for row in table.read().to_pylist() if row["method"] == "count-points" or row["epoch"] > 0]
    table.path.unlink()
    table.add(kept)
    report_study(tmp_path / "study", tmp_path / "page.html")
    assert "No scenes: no epoch where both" in (tmp_path / "page.html").read_text()


def test_rows_without_an_answer_are_told(copied, small_space, tmp_path):
    scans = sorted(copied.scans.glob("*.bin"))
    for scan in scans:
        scan.write_bytes(b"")
    names = ["count-points", "helmert-points"]
    run_study(copied, tmp_path / "study", choose_methods(names, small_space), n_workers=1)
    report_study(tmp_path / "study", tmp_path / "bad.html")
    text = (tmp_path / "bad.html").read_text()
    assert "12: unreadable scan, such as: Expected float32" in text
    assert "0 of 6" in text


def test_what_cannot_be_reported_is_said(study, simulated, small_space, tmp_path):
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
