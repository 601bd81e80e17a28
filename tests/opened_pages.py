"""A page as a reader sees it, in headless Chromium; tests that open one are skipped where none is installed."""

import shutil

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def assert_whole(path, width, scheme, n_images):
    """A page opens without a complaint, shows all its pictures, fits the screen, and asks for nothing."""
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
        page.goto(path.as_uri())
        are_shown = page.evaluate("[...document.images].map(image => image.complete && image.naturalWidth > 100)")
        overflow = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        browser.close()
    assert (said, are_shown, overflow) == ([], [True] * n_images, 0)
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
