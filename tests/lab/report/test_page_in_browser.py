# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The page as a reader sees it, in headless Chromium; skipped where none is installed."""

import shutil

import numpy as np
import pytest
from test_demo_page import summary

import maxcon
from drawn_figures import parts, yard
from maxcon.lab.report import Picture, write_page
from maxcon.lab.report.study_statistics import plot_error_distributions

pytestmark = pytest.mark.browser

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: the page is not opened")
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: the page is not opened")
    with playwright.sync_playwright() as engine:
        chromium = engine.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    maxcon.plot_epoch(folder / "epoch.png", **parts(), title="A yard")
    plot_error_distributions(folder / "errors.svg", {"Count": np.array([0.1, 3.0]), "Helmert": np.array([0.1, 0.1])})
    maxcon.plot_drive(folder / "drive.png", [[-5.0, 0.0], [5.0, 0.0]], [0.1, 0.2], point_map=yard().point_map)
    epoch = Picture("Yard", "Caption.", "Squares.", folder / "epoch.png")
    page = {
        "title": "A page with AVeryLongWordThatDoesNotFitOnAPhoneAndCannotBeBrokenAnywhere",
        "headline": "A headline. " * 20,
        "results": [summary("Count", "points", 40, 40, 31, 0.052, 5.54, 0.03, 81.0)] * 2,
        "why": epoch,
        "wide": epoch,
        "epoch": epoch,
        "spaces": epoch,
        "errors": Picture("Errors", "Caption.", "Chart.", folder / "errors.svg"),
        "drive": Picture("Drive", "Caption.", "Map.", folder / "drive.png"),
        "facts": {"Map": "4.1 million points"},
        "command": "maxcon demo --out " + "folder/" * 30,
        "version": "0.1.0",
        "seed": 0,
    }
    write_page(folder / "demo.html", "demo.html.j2", page)
    return folder / "demo.html"


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_opens_whole_and_asks_for_nothing(browser, page_file, width, scheme):
    page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    complaints, requests = [], []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.on("requestfailed", lambda request: complaints.append(request.url))
    page.goto(page_file.as_uri(), wait_until="load")
    assert page.evaluate("Array.from(document.images, image => image.naturalWidth > 0)") == [True] * 6
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert complaints == []
    assert [url for url in requests if not url.startswith("data:")] == [page_file.as_uri()]
    page.close()
