"""Habits that a machine can check: tools, archive, changes; and that source and design cite what is there."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
KINDS = {kind["directory"] for kind in PROJECT["tool"]["towncrier"]["type"]}
NAMING = [ROOT / "CONTRIBUTING.md", ROOT / "docs" / "releasing.md", ROOT / ".github" / "workflows" / "tests.yml"]


def test_linters_are_of_one_version_everywhere():
    linters = PROJECT["project"]["optional-dependencies"]["lint"]
    assert {re.split("==", each)[0] for each in linters} == {"codespell", "import-linter", "mypy", "ruff"}
    assert all(re.fullmatch(r"[a-z-]+==[\d.]+", each) for each in linters)
    assert "rev:" not in (ROOT / ".pre-commit-config.yaml").read_text(), "versions stand in pyproject.toml"


@pytest.mark.parametrize("path", NAMING, ids=lambda path: path.name)
def test_commands_of_the_repository_exist(path):
    named = set(re.findall(r"(?<![\w/])\.ci/\w+", path.read_text()))
    assert named and [name for name in named if not (ROOT / name).is_file()] == []


def test_the_linters_run_everywhere_alike():
    commands = re.findall(r"^(\w[\w-]*)", (ROOT / ".ci" / "lint").read_text().partition("PATH=")[2], re.MULTILINE)
    assert [name for name in commands if name not in (ROOT / ".pre-commit-config.yaml").read_text()] == []
    assert ".ci/lint" in (ROOT / ".ci" / "run").read_text()


def test_the_archive_has_what_contributors_read():
    archived = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    assert {"CONTRIBUTING.md", "CHANGELOG.md", "CITATION.cff", "LICENSE", "tests", "docs", "changes"} <= set(archived)
    assert [name for name in archived if not (ROOT / name).exists()] == []


def test_names_of_test_files_are_unique():
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def test_changes_are_of_a_kind_that_the_changelog_knows():
    changes = [path.name for path in (ROOT / "changes").glob("*.md") if path.name != "README.md"]
    assert [name for name in changes if not re.fullmatch(rf"(\+[\w-]+|\d+)\.({'|'.join(KINDS)})\.md", name)] == []


@pytest.mark.parametrize("name", ["run", "archives"])
def test_nothing_is_removed_but_what_was_made(name):
    """Not a developer's environment, above all."""
    removed = re.findall(r"rm -r\w* (\S+)", (ROOT / ".ci" / name).read_text())
    assert set(removed) <= {'"$work"\'', '"$work"', "dist"}


SOURCE = ROOT / "src" / "maxcon"
DESIGN = ROOT / "docs" / "design.md"
PAGES = (DESIGN, ROOT / "docs" / "one_epoch.md", ROOT / "docs" / "paper_to_code.md")

DECISIONS = re.compile(r"\((?:[^()]*\b)?D\d+[^()]*\)")  # "(D4, D7)"
SECTION = re.compile(r"design,? section (\d+)(?:, facts? (\d+)(?: and (\d+))?)?")
SPAN = re.compile(r"`([A-Za-z_]\w*(?:\.\w+)+)(?:\([^`]*\))?`")


@pytest.fixture(scope="module")
def sections():
    """Each section of the design, by its number."""
    parts = re.split(r"^## (\d+)\. ", DESIGN.read_text(), flags=re.MULTILINE)
    return {int(number): text for number, text in zip(parts[1::2], parts[2::2], strict=True)}


def _cited(pattern):
    """(file, match) of a pattern in all sources, line breaks and comment signs taken as blanks."""
    for path in sorted([*SOURCE.rglob("*.py"), *(ROOT / "tests").rglob("*.py")]):
        text = " ".join(re.sub(r"\n\s*#?", " ", path.read_text()).split())
        for found in pattern.finditer(text):
            yield path.name, found


def test_every_decision_that_the_source_cites_is_in_the_design(sections):
    there = {int(number) for number in re.findall(r"^\| D(\d+) \|", sections[2], flags=re.MULTILINE)}
    assert there == set(range(1, 13))
    cited = {int(n): name for name, found in _cited(DECISIONS) for n in re.findall(r"\bD(\d+)\b", found.group())}
    assert len(cited) >= 8
    assert {number: name for number, name in cited.items() if number not in there} == {}


def test_every_section_and_fact_that_the_source_cites_is_in_the_design(sections):
    cited = list(_cited(SECTION))
    assert cited
    for name, found in cited:
        section, *facts = (int(number) for number in found.groups() if number)
        assert section in sections, name
        for fact in facts:
            assert re.search(rf"^{fact}\. ", sections[section], flags=re.MULTILINE), f"{name}: {found.group()}"


def _is_in_the_source(dotted):
    """Whether a dotted name is one of maxcon: of its modules, and of what they hold, fields of classes too."""
    names, found = dotted.split("."), importlib.import_module("maxcon")
    for number, name in enumerate(names, 1):
        if not hasattr(found, name) and name not in getattr(found, "__annotations__", {}):
            try:
                importlib.import_module(".".join(["maxcon", *names[:number]]))
            except ModuleNotFoundError:
                return False
        found = getattr(found, name, None)
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_names_with_dots_are_of_the_source(page):
    prose = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    names = {name for name in SPAN.findall(prose) if not name.endswith((".py", ".toml", ".csv", ".map"))}
    assert len(names) > 3 and [name for name in sorted(names) if not _is_in_the_source(name)] == []


def test_every_room_of_the_source_is_in_the_design(sections):
    rooms = {path.parent.name for path in SOURCE.glob("*/__init__.py")}
    assert set(re.findall(r"\b(\w+)/", sections[6].partition("```\n\n")[0])) - {"src", "maxcon"} == rooms
