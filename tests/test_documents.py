"""What the documents say is so: code runs, commands, options and names exist, links lead somewhere; licences."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from urllib.parse import unquote

import pytest
import typer

import maxcon
from maxcon.cli import app

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
SPDX = ("# SPDX-FileCopyrightText: 2026 the maxcon authors", "# SPDX-License-Identifier: MIT")

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
EXPECTED = re.compile(r"# (.+)$")


def _name(path):
    return str(path.relative_to(ROOT))


def _blocks(path, *languages):
    return [body for language, body in FENCE.findall(path.read_text()) if language in languages]


def _anchors(path):
    """Anchors of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", path.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", LINK.sub("", heading).lower()).strip().replace(" ", "-") for heading in headings}


def _links_astray(path):
    """Links of a page to files or headings that are not there, or out of the repository."""
    for target in LINK.findall(path.read_text()):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = unquote(target).partition("#")
        file = path.parent / name if name else path
        if not file.exists() or ROOT not in file.resolve().parents or (anchor and anchor not in _anchors(file)):
            yield f"{_name(path)}: {target}"


def test_links_lead_somewhere():
    assert [link for path in DOCUMENTS for link in _links_astray(path)] == []


def _command_lines(text):
    """The maxcon commands of a block or of a line of prose, without what stands before and after them."""
    for line in text.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&|\||;", line.partition(" #")[0]):
            words = part.split()
            if words and words[0].removeprefix(".venv/bin/") == "maxcon":
                yield part.strip()


def _command_of(words):
    """Walk down the tree of commands; return the last one and the words that follow."""
    command, rest = typer.main.get_command(app), list(words)
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        assert rest[0] in command.commands, f"maxcon has no command {rest[0]!r}"
        command = command.commands[rest.pop(0)]
    return command, rest


def _option_names(command):
    return {name for option in command.params for name in (*option.opts, *option.secondary_opts)} | {"--help"}


def test_commands_in_blocks_have_the_options_they_name():
    for path in DOCUMENTS:
        for block in _blocks(path, "sh", ""):
            for line in _command_lines(block):
                command, rest = _command_of(shlex.split(line)[1:])
                named = {word.partition("=")[0] for word in rest if re.match(r"-+[a-z]", word)}
                assert named <= _option_names(command), f"{_name(path)}: {line}"


def test_commands_and_options_in_the_prose_exist():
    todo, options = [typer.main.get_command(app)], set()
    while todo:
        command = todo.pop()
        options |= _option_names(command)
        todo.extend(getattr(command, "commands", {}).values())
    for path in DOCUMENTS:
        for span in re.findall(r"`([^`\n]+)`", FENCE.sub("", path.read_text())):
            first, *rest = span.split()
            if first == "maxcon":
                _command_of(rest)
            if re.fullmatch(r"--[a-z][a-z-]*", first):
                assert first in options, f"{_name(path)}: {span}"


def test_the_readme_shows_its_commands():
    lines = [line for block in _blocks(ROOT / "README.md", "sh") for line in _command_lines(block)]
    named = {shlex.split(line)[1] for line in lines}
    assert {"demo", "map", "localize", "export"} <= named
    assert len((ROOT / "README.md").read_text().split()) < 700


@pytest.mark.documents
@pytest.mark.parametrize("path", [
    # The tutorial's goes on where its commands ended: test_tutorial.
    path for path in DOCUMENTS if _blocks(path, "python") and path.name != "tutorial.md"
], ids=_name)  # fmt: skip
def test_python_in_documents_runs_and_prints_what_it_says(path, tmp_path):
    source = "\n".join(_blocks(path, "python"))
    command = [sys.executable, "-W", "error", "-c", source]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=900)
    assert (ended.returncode, ended.stderr) == (0, "")
    prints = [line for line in source.splitlines() if line.startswith("print(")]
    wanted = [found.group(1) for line in prints if (found := EXPECTED.search(line))]
    assert len(wanted) == len(prints), "each print says behind it what it prints"
    assert ended.stdout.splitlines() == wanted


def test_every_public_name_is_on_the_page_of_names_and_has_a_purpose():
    names = [name for name in maxcon.__all__ if name != "__version__"]
    reference = (ROOT / "docs" / "api.md").read_text()
    listed = {"search" if name == "maxcon.search" else name for name in re.findall(r":: (\S+)", reference)}
    assert [name for name in names if name not in listed | {"MaxconError"}] == []
    purposes = (ROOT / "docs" / "library.md").read_text()
    assert [name for name in names if not re.search(rf"`[^`]*\b{name}\b[^`]*`", purposes)] == []


def test_all_python_is_licensed():
    files = [path for folder in ("benchmarks", "examples") for path in (ROOT / folder).rglob("*.py")]
    assert [_name(path) for path in files if tuple(path.read_text().splitlines()[:2]) != SPDX] == []
    (of_others,) = tomllib.loads((ROOT / "REUSE.toml").read_text())["annotations"]
    assert of_others.pop("path") == ["src/**", "tests/**"]
    assert tuple(f"# {name}: {value}" for name, value in of_others.items()) == SPDX


# A number with what it counts or is measured in: "70 of 70", "4.1 cm", "2 million points".
FIGURE = re.compile(r"\d[\d,]*(?:\.\d+)?\s(?:of\s\d[\d,]*|million|cm\b|ms\b|s\b|GiB|epochs|poses|points|%)")


def _plain(text):
    """The words of Markdown, a blank between them."""
    return " ".join(re.sub(r"[*`\[\]]", "", re.sub(r"\]\([^)]*\)", "]", text)).split())


@pytest.mark.parametrize(
    ("heading", "page"), [("What was measured", "figures"), ("Is registration not enough?", "latency")]
)
def test_the_figures_of_the_readme_are_those_of_the_page(heading, page):
    _, _, rest = (ROOT / "README.md").read_text().partition(f"## {heading}\n")
    found = FIGURE.findall(_plain(rest.partition("\n## ")[0]))
    there = _plain((ROOT / "docs" / f"{page}.md").read_text())
    assert len(found) >= 5
    assert [figure for figure in found if not re.search(rf"(?<![\d.,]){re.escape(figure)}", there)] == []
