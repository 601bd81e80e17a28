"""Levels of a prior's error, priors drawn at them, a table by level; the benchmarks of these and of latency."""

import importlib
import math
from dataclasses import replace
from pathlib import Path

import pytest

from maxcon import MaximumConsensus, Pose, Scan, SearchSpace
from maxcon.errors import OptionError
from maxcon.lab.baselines import CountThenGicp, MultiStart
from maxcon.lab.study import prior_trials
from maxcon.lab.study.methods import MAP_VARIANTS
from study_tables import study_table
from walled_towns import TRUTH, made

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
NEAR = prior_trials.prior_level(3.0, 2.0)
REFERENCE = Pose(100.0, -50.0, 2.0, 0.01, -0.02, 1.0)


def row(method, epoch=0, level="12 m, 10°", *, good=True, right=True, distance=0.1, ms=10.0):
    known = {"prior": level, "method": method, "epoch": epoch, "status": "localized" if good else "at the rim"}
    return known | {"is_localized": good, "is_success": right, "distance": distance, "ms": ms, "reference_x": 0.0}


ROWS = [
    row("maxcon", 0, ms=10.0), row("maxcon", 1, right=False, distance=5.0, ms=20.0),
    row("maxcon", 2, good=False, distance=0.2, ms=40.0), row("a", 0, good=False, right=False, distance=3.0, ms=1.0),
    row("maxcon", 0, "3 m, 2°", distance=0.05, ms=7.0),
]  # fmt: skip
LEVELS = [prior_trials.prior_level(3.0, 2.0), prior_trials.prior_level(6.0, 5.0), prior_trials.prior_level(12.0, 10.0)]


def test_statistics_by_hand_in_the_order_of_levels_and_methods():
    found = prior_trials.statistics_by_level(study_table(ROWS), LEVELS)
    assert {level: [one.method for one in of_level] for level, of_level in found.items()} == {
        "3 m, 2°": ["maxcon"],
        "12 m, 10°": ["maxcon", "a"],
    }
    wide, none = found["12 m, 10°"]
    assert (wide.n_epochs, wide.n_success, wide.n_localized, wide.n_false, wide.ms.median) == (3, 2, 2, 1, 20.0)
    assert (none.n_success, none.n_false) == (0, 0)


@pytest.fixture
def module_of_benchmarks(monkeypatch):
    """Import a benchmark by its name."""
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


def test_all_stages_of_a_search_are_seen(module_of_benchmarks):
    latency, (point_map, scan) = module_of_benchmarks("latency"), made(1)
    stages = latency.StageTimes()
    with stages.watching():
        MaximumConsensus(SearchSpace(3.0, heading_half_width_deg=2.0)).localize(Scan(scan.points), point_map, TRUTH)
    assert set(stages.ms) == set(latency.STAGES)


def test_the_table_has_a_row_per_level_and_method(module_of_benchmarks):
    lines = module_of_benchmarks("prior_error").table(study_table(ROWS), LEVELS)
    assert lines[2:] == [
        "| 3 m, 2° | maxcon | **1 of 1** | 1 | 0 | 7 | 7 | 5.0 |",
        "| 12 m, 10° | maxcon | 2 of 3 | 2 | 1 | 20 | 38 | 15.0 |",
        "|  | a | 0 of 1 | 0 | 0 | 1 | 1 | – |",
    ]
    assert len({line.count("|") for line in lines}) == 1


def test_a_folder_of_other_trials_is_refused(module_of_benchmarks, tmp_path):
    prior_error = module_of_benchmarks("prior_error")

    def check(level, seed):
        prior_error.check_same(tmp_path, prior_error.settings_of([prior_error.parse_level(level)], seed))

    for level in ("1:1", "1:1", "12:10"):
        check(level, 0)
    with pytest.raises(OptionError, match="same methods and seed"):
        check("1:1", 1)


def test_priors_are_within_their_level_and_only_in_x_y_and_heading():
    level = prior_trials.prior_level(12.0, 10.0)
    priors = [prior_trials.prior_at(REFERENCE, level, 0, epoch) for epoch in range(400)]
    dx = [prior.x - REFERENCE.x for prior in priors]
    turns = [math.degrees(prior.heading - REFERENCE.heading) for prior in priors]
    assert -12.0 <= min(dx) < -11.0 and 11.0 < max(dx) <= 12.0
    assert -10.0 <= min(turns) < -9.0 and 9.0 < max(turns) <= 10.0
    assert all(replace(prior, x=REFERENCE.x, y=REFERENCE.y, heading=REFERENCE.heading) == REFERENCE for prior in priors)


def test_a_prior_depends_on_nothing_but_seed_epoch_and_level():
    first = prior_trials.prior_at(REFERENCE, NEAR, 0, 7)
    prior_trials.prior_at(REFERENCE, prior_trials.prior_level(6.0, 5.0), 0, 3)
    assert prior_trials.prior_at(REFERENCE, NEAR, 0, 7) == first
    others = [
        prior_trials.prior_at(REFERENCE, NEAR, 1, 7),
        prior_trials.prior_at(REFERENCE, NEAR, 0, 8),
        prior_trials.prior_at(REFERENCE, prior_trials.prior_level(3.0, 2.5), 0, 7),
    ]
    assert len({first, *others}) == 4


def test_methods_are_told_the_level():
    level = prior_trials.prior_level(6.0, 5.0)
    found = {method.name: method for method in prior_trials.methods_at(level)}
    assert next(iter(found)) == prior_trials.MAXCON
    space = found[prior_trials.MAXCON].method.space
    assert found[prior_trials.MAXCON].method == MaximumConsensus(space) and space.is_open
    assert (space.half_width, space.heading_half_width_deg) == (6.0, 5.0)
    assert {method.map_name for method in found.values()} == {"standard", "ground"} <= set(MAP_VARIANTS)
    many, count = found[prior_trials.GICP_FROM_MANY].method, found[prior_trials.COUNT_THEN_GICP].method
    assert isinstance(many, MultiStart) and isinstance(count, CountThenGicp)
    starts = many.starts(REFERENCE)
    assert len(starts) == 75
    assert max(start.x for start in starts) - REFERENCE.x == pytest.approx(6.0 - many.spacing / 2)
    turn = math.degrees(max(start.heading for start in starts) - REFERENCE.heading)
    assert turn == pytest.approx(5.0 - many.heading_spacing_deg / 2)
    assert (count.half_width, count.heading_half_width_deg) == (6.0, 5.0)
    names = [method.name for method in prior_trials.methods_at(level, gates=(1.0, 6.0))]
    assert names[3:] == ["GICP, gate 1 m", "GICP, gate 6 m", "ICP, gate 1 m"]
