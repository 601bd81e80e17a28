# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the parts of a search hand to each other cannot be changed under way: threads and heights share it."""

import importlib
import inspect
import pkgutil
from dataclasses import is_dataclass

import pytest

import maxcon.search

MODULES = [f"maxcon.search.{module.name}" for module in pkgutil.iter_modules(maxcon.search.__path__)]
STATES = {"BoundedSearch"}  # what a search knows so far


@pytest.mark.parametrize(
    "name", [*MODULES, "maxcon.search.coarse_to_fine", "maxcon.cell_search", "maxcon.search.best_cell"]
)
def test_records_are_frozen(name):
    classes = [kind for _, kind in inspect.getmembers(importlib.import_module(name), inspect.isclass)]
    classes = [kind for kind in classes if is_dataclass(kind)]
    assert [kind for kind in classes if kind.__name__ not in STATES and not kind.__dataclass_params__.frozen] == []
