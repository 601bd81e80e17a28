# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from maxcon.errors import FileError, MissingExtraError
from maxcon.lab.report import DemoPage, MethodSummary, Picture, plot_errors, write_demo_page

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{ 7 * 7 }}"


class Tags(HTMLParser):
    """Every tag of a page with its attributes, and all its text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data

    def named(self, name):
        return [attributes for tag, attributes in self.tags if tag == name]


@pytest.fixture(scope="module")
def page(tiny_png, tmp_path_factory):
    svg = tmp_path_factory.mktemp("svg") / "errors.svg"
    plot_errors(svg, [0.0, 1.0], {"Count": [0.1, 3.0]})
    picture = Picture("A street", "Count fails.", "Two squares.", tiny_png)
    return DemoPage(
        title="maxcon demo",
        headline="A car was localized in 40 of 40 epochs.",
        methods=(
            MethodSummary("Count", "points", 40, 40, 31, 0.052, 5.54, 1.9, 81.0),
            MethodSummary("ICP", "", 40, 0, 0, None, None, None, None),
        ),
        epochs=(picture, replace(picture, title="A crossing", source=tiny_png.read_bytes())),
        command="maxcon demo --seed 3",
        version="0.1.0",
        seed=3,
        errors=Picture("Errors", "Over the drive.", "A chart.", svg),
        drive=replace(picture, title="The drive"),
        facts=(("Map", "4.1 million points"),),
    )


@pytest.fixture(scope="module")
def written(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "demo.html"
    write_demo_page(path, page)
    return path


def test_page_tells_what_was_done(written):
    text = re.sub(r"\s+", " ", Tags(written.read_text("utf-8")).text)
    for words in ("A car was localized in 40 of 40 epochs.", "maxcon demo --seed 3", "maxcon 0.1.0, seed 3"):
        assert words in text
    for words in ("A cell is one possible pose", "Counting can be fooled", "4.1 million points"):
        assert words in text


def test_table_has_a_row_per_method_and_a_dash_for_no_number(written):
    rows = re.findall(r"<tr><th scope=\"row\">(.*?)</tr>", written.read_text("utf-8"))
    cells = [re.sub(r"<[^>]+>", "|", row).replace("||", "|").strip("|").split("|") for row in rows]
    assert cells == [
        ["Count", "points", "40 of 40", "31 of 40", "0.052", "5.54", "1.90", "81"],
        ["ICP", "–", "0 of 40", "0 of 40", "–", "–", "–", "–"],
    ]


def test_everything_is_escaped(page, tmp_path):
    picture = replace(page.epochs[0], title=HOSTILE, caption=HOSTILE, alt=HOSTILE)
    hostile = replace(
        page,
        title=HOSTILE,
        headline=HOSTILE,
        command=HOSTILE,
        version=HOSTILE,
        epochs=(picture,),
        methods=(replace(page.methods[0], name=HOSTILE, multiplicity=HOSTILE),),
        facts=((HOSTILE, HOSTILE),),
    )
    write_demo_page(tmp_path / "demo.html", hostile)
    tags = Tags((tmp_path / "demo.html").read_text("utf-8"))
    assert not tags.named("script")
    assert all(set(attributes) == {"src", "alt"} for attributes in tags.named("img"))
    assert tags.named("img")[-1]["alt"] == HOSTILE
    assert HOSTILE in tags.text


def test_nothing_is_fetched_from_anywhere(written):
    text = written.read_text("utf-8")
    assert re.findall(r"https?://", text) == []
    tags = Tags(text)
    assert not tags.named("script")
    addresses = [tag[1][key] for tag in tags.tags for key in ("src", "href", "srcset") if key in tag[1]]
    assert len(addresses) == 5
    assert all(address.startswith("data:") for address in addresses)
    assert "url(" not in text and "@import" not in text


def test_page_is_ready_for_phones_and_for_those_who_cannot_see(written):
    tags = Tags(written.read_text("utf-8"))
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in tags.named("meta")
    assert tags.named("html") == [{"lang": "en"}]
    assert all(image["alt"] for image in tags.named("img"))


def test_same_input_gives_the_same_bytes(page, written, tmp_path):
    write_demo_page(tmp_path / "demo.html", page)
    assert (tmp_path / "demo.html").read_bytes() == written.read_bytes()


def test_page_without_pictures_is_written(page, tmp_path):
    write_demo_page(tmp_path / "demo.html", replace(page, epochs=(), errors=None, drive=None, seed=None))
    text = (tmp_path / "demo.html").read_text("utf-8")
    assert "<img" not in text and "seed " not in text.replace("--seed ", "")


@pytest.mark.parametrize("source", [b"", b"GIF89a", b"<html></html>", "missing.png"])
def test_a_picture_that_is_none_leaves_no_page(page, tmp_path, source):
    broken = replace(page, epochs=(Picture("Broken", "", "", source),))
    with pytest.raises(FileError, match=r"Expected .*(to be a PNG or an SVG|to read the picture)"):
        write_demo_page(tmp_path / "demo.html", broken)
    assert list(tmp_path.iterdir()) == []


def test_without_jinja2_the_extra_is_named(page, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[demo\]'"):
        write_demo_page(tmp_path / "demo.html", page)
