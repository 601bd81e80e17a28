"""The benchmark of latency: what is timed as a stage."""

import importlib
from pathlib import Path

import pytest

from maxcon import MaximumConsensus, Scan, SearchSpace
from walled_towns import TRUTH, made

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture
def latency(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("latency")


def test_all_stages_of_a_search_are_seen(latency):
    point_map, scan = made(1)
    stages = latency.StageTimes()
    with stages.watching():
        MaximumConsensus(SearchSpace(3.0, heading_half_width_deg=2.0)).localize(Scan(scan.points), point_map, TRUTH)
    assert set(stages.ms) == set(latency.STAGES)
