import re
from dataclasses import replace
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest

from maxcon.lab.report import Picture, write_page
from maxcon.lab.report.charts import plot_error_distributions
from maxcon.search.space import SearchSpace
from opened_pages import assert_whole

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{ 7 * 7 }}"


def method(objective, multiplicity):
    return SimpleNamespace(objective=type(objective, (), {})(), multiplicity=multiplicity)


def summary(name, n_epochs, n_localized, n_success, median, worst, heading, ms):
    """What the table shows of a method's results."""
    return SimpleNamespace(
        method=name, n_epochs=n_epochs, n_success=n_success, distance=SimpleNamespace(median=median, worst=worst),
        heading_error=SimpleNamespace(worst=heading), n_localized=n_localized, ms=SimpleNamespace(median=ms),
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    for name in ("errors.svg", "tiny.png"):
        plot_error_distributions(folder / name, {"Count": np.array([0.1, 3.0])})
    picture = Picture("A street", "Count fails.", "Two squares.", folder / "tiny.png")
    return {
        "title": "maxcon demo",
        "methods": {"a": method("Count", "points"), "b": method("Helmert", "<&>")},
        "results": [
            summary("a", 40, 40, 31, 0.052, 5.54, 0.0331613, 81.0),
            summary("b", 40, 0, 0, float("nan"), float("nan"), float("nan"), 7.0),
        ],
        "why": picture,
        "wide": picture,
        "epoch": picture,
        "spaces": replace(picture, title="A crossing"),
        "errors": Picture("Errors", "Over the drive.", "A chart.", folder / "errors.svg"),
        "drive": replace(picture, title="The drive"),
        "space": SearchSpace.paper(),
        "n_tiles": 12,
        "n_scans": 40,
        "command": "maxcon demo --seed 3",
        "version": "0.1.0",
        "seed": 3,
    }


@pytest.fixture(scope="module")
def written(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "demo.html"
    write_page(path, "demo.html.j2", page)
    return path


def test_table_has_a_row_per_method_and_a_dash_for_no_number(written):
    rows = re.findall(r"<tr><th scope=\"row\">(.*?)</tr>", written.read_text("utf-8"))
    cells = [re.sub(r"<[^>]+>", "|", row).replace("||", "|").strip("|").split("|") for row in rows]
    assert cells == [
        ["Count", "points", "40 of 40", "31 of 40", "0.052", "5.54", "1.90", "81"],
        ["Helmert", "&lt;&amp;&gt;", "0 of 40", "0 of 40", "–", "–", "–", "7"],
    ]


def test_everything_is_escaped(page, tmp_path):
    picture = replace(page["why"], title=HOSTILE, caption=HOSTILE, alt=HOSTILE)
    words = dict.fromkeys(("title", "n_tiles", "n_scans", "command", "version", "seed"), HOSTILE)
    write_page(tmp_path / "demo.html", "demo.html.j2", page | words | {"spaces": picture})
    text = (tmp_path / "demo.html").read_text("utf-8")
    assert "<script" not in text
    images = [re.fullmatch('src="[^"]*" alt="([^"]*)"', found) for found in re.findall("<img ([^>]*)>", text)]
    assert unescape(images[-1].group(1)) == HOSTILE and None not in images
    assert unescape(re.sub("<[^>]*>", "", text)).count(HOSTILE) >= 8


@pytest.mark.browser
@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1280, "dark")])
def test_a_browser_shows_it_whole(page, tmp_path, width, scheme):
    long = {"title": "A page with AVeryLongWordThatDoesNotFitOnAPhoneAndCannotBeBrokenAnywhere", "n_tiles": "A. " * 200}
    write_page(tmp_path / "demo.html", "demo.html.j2", page | long | {"command": "maxcon demo --out " + "folder/" * 30})
    assert_whole(tmp_path / "demo.html", width, scheme, 6)


def test_nothing_is_fetched_from_anywhere(written):
    text = written.read_text("utf-8")
    assert re.findall(r"https?://", text) == [] and "<script" not in text
    addresses = re.findall('(?:src|href|srcset)="([^"]*)"', text)
    assert len(addresses) == 7 and all(address.startswith("data:") for address in addresses)
    assert "url(" not in text and "@import" not in text
