# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What keeps the repository in order: linters of one version, commands that exist, one way to run everything."""

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
    assert named
    assert [name for name in named if not (ROOT / name).is_file()] == []


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
