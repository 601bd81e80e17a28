# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the documents say is so: code runs, commands and options exist, links lead somewhere; sizes and licences."""

import re
import shlex
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest
import typer

import maxcon
from maxcon.cli import app

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
SPDX = ("# SPDX-FileCopyrightText: 2026 the maxcon authors", "# SPDX-License-Identifier: MIT")

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
EXPECTED = re.compile(r"# (.+)$")


def _name(path):
    return str(path.relative_to(ROOT))


def _blocks(path, *languages):
    return [body for language, body in FENCE.findall(path.read_text()) if language in languages]


def _command_lines(text):
    """The maxcon commands of a block or of a line of prose, without what stands before and after them."""
    joined = text.replace("\\\n", " ")
    for line in joined.splitlines():
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


def _all_option_names():
    todo, names = [typer.main.get_command(app)], set()
    while todo:
        command = todo.pop()
        names |= _option_names(command)
        todo.extend(getattr(command, "commands", {}).values())
    return names


@pytest.mark.parametrize("path", DOCUMENTS, ids=_name)
def test_links_lead_somewhere(path):
    for target in LINK.findall(path.read_text()):
        if not re.match(r"[a-z]+:", target) and not target.startswith("#"):
            file = path.parent / unquote(target.partition("#")[0])
            assert file.exists(), f"{_name(path)} links to {target}"
            assert ROOT in file.resolve().parents, f"{_name(path)} links out of the repository: {target}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=_name)
def test_commands_in_blocks_have_the_options_they_name(path):
    for block in _blocks(path, "sh", "bash", "console", ""):
        for line in _command_lines(block):
            command, rest = _command_of(shlex.split(line)[1:])
            known = _option_names(command)
            for word in rest:
                if word.startswith("-") and not re.match(r"-\d", word):
                    assert word.partition("=")[0] in known, f"{_name(path)}: {line}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=_name)
def test_commands_and_options_in_the_prose_exist(path):
    prose = FENCE.sub("", path.read_text())
    for span in re.findall(r"`([^`\n]+)`", prose):
        words = span.split()
        if words[0] == "maxcon":
            _command_of(words[1:])
        if re.fullmatch(r"--[a-z][a-z-]*", words[0]):
            assert words[0] in _all_option_names(), f"{_name(path)}: {span}"


def test_the_readme_s_commands_are_found_at_all():
    lines = [line for block in _blocks(ROOT / "README.md", "sh") for line in _command_lines(block)]
    named = {" ".join(shlex.split(line)[1:3]) for line in lines}
    assert {"map build", "map info"} <= named
    assert any(name.startswith("localize") for name in named) and any(name.startswith("demo") for name in named)


WITH_PYTHON = [path for path in DOCUMENTS if _blocks(path, "python") and path.name != "tutorial.md"]
"""The tutorial's goes on where its commands ended: test_tutorial."""


@pytest.mark.parametrize("path", WITH_PYTHON, ids=_name)
def test_python_in_documents_runs_and_prints_what_it_says(path, tmp_path):
    source = "\n".join(_blocks(path, "python"))
    ended = subprocess.run(
        [sys.executable, "-W", "error", "-c", source],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=900,  # it may have to compile
    )
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


def test_the_readme_has_python():
    assert _blocks(ROOT / "README.md", "python")


@pytest.mark.parametrize("path", SOURCES, ids=_name)
def test_sources_are_licensed(path):
    assert tuple(path.read_text().splitlines()[:2]) == SPDX


@pytest.mark.parametrize("folder", ["tests", "benchmarks", "examples"])
def test_all_python_is_licensed(folder):
    for path in sorted((ROOT / folder).rglob("*.py")):
        assert tuple(path.read_text().splitlines()[:2]) == SPDX, _name(path)


def test_names_of_test_files_are_unique():
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


# A number with what it counts or is measured in: "70 of 70", "4.1 cm", "2 million points".
FIGURE = re.compile(r"\d[\d,]*(?:\.\d+)?\s(?:of\s\d[\d,]*|million|cm\b|ms\b|s\b|GiB|epochs|poses|points|%)")
MEASURED_PARTS = ("## What was measured", "![Right answers")


def _plain(text):
    """The words of Markdown, a blank between them."""
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return " ".join(re.sub(r"[*`\[\]]", "", text).split())


def _measured_in_the_readme():
    """Parts of the README that state figures: from each mark to the next heading or picture."""
    text = (ROOT / "README.md").read_text()
    parts = []
    for mark in MEASURED_PARTS:
        rest = text[text.index(mark) + len(mark) :]
        parts.append(_plain(re.split(r"\n(?:## |!\[)", rest)[0]))
    return " ".join(parts)


def test_the_figures_of_the_readme_are_those_of_the_page_of_figures():
    found = FIGURE.findall(_measured_in_the_readme())
    page = _plain((ROOT / "docs" / "figures.md").read_text())
    assert len(found) > 10
    assert [figure for figure in found if not re.search(rf"(?<![\d.,]){re.escape(figure)}", page)] == []
