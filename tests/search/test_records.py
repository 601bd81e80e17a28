# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the parts of a search hand to each other is frozen, and compares by identity where it holds arrays."""

import importlib
import inspect
import pkgutil
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

import maxcon.search
from maxcon import Accumulator, Estimate, Pose, SearchSpace, Status

MODULES = [f"maxcon.search.{module.name}" for module in pkgutil.iter_modules(maxcon.search.__path__)]


@pytest.mark.parametrize("name", [*MODULES, "maxcon.cell_search", "maxcon.estimate", "maxcon.integrity"])
def test_records_are_frozen_and_those_of_arrays_have_no_generated_equality(name):
    classes = [kind for _, kind in inspect.getmembers(importlib.import_module(name), inspect.isclass)]
    classes = [kind for kind in classes if is_dataclass(kind) and kind.__module__ == name]
    assert [kind for kind in classes if not kind.__dataclass_params__.frozen] == []
    arrays = ("NDArray", "Moments", "Scores")
    of_arrays = [kind for kind in classes if any(word in str(each.type) for each in fields(kind) for word in arrays)]
    assert [kind for kind in of_arrays if kind.__dataclass_params__.eq] == []


def test_answers_can_be_compared():
    pose, space = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), SearchSpace(0.6, 0.06, 0.0)
    for make in (
        lambda: Estimate(pose, 1.0, None, Status.LOCALIZED, np.eye(2)),
        lambda: Accumulator(np.zeros((1, 20, 20, 4)), space, pose),
    ):
        one = make()
        assert one == one and one != make()
