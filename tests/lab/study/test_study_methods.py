"""Methods by name, what is saved of them, and the numbers a study sums up to."""

import pickle
import sys

import pytest

from maxcon._system.resumable import describe
from maxcon.errors import OptionError
from maxcon.lab import study
from maxcon.lab.study.methods import CELL, MAP_VARIANTS
from maxcon.localizer import MaximumConsensus
from maxcon.search.objectives import Count
from maxcon.search.space import SearchSpace
from study_tables import study_table


def test_every_set_is_of_known_methods_in_the_cells_of_their_maps_that_travel_to_other_processes():
    known = study.known_methods(SearchSpace.paper())
    assert {name for names in study.METHOD_SETS.values() for name in names} <= set(known)
    for method in known.values():
        assert describe(pickle.loads(pickle.dumps(method))) == describe(method)
        space, cell = getattr(method.method, "space", None), MAP_VARIANTS[method.map_name].get("cell", CELL)
        if space is not None and not space.is_open:
            assert space.cell == cell and 3.0 <= space.half_width < 3.0 + cell


def test_names_and_sets_mix():
    chosen = study.choose_methods(["helmert-occupied", "weights"], SearchSpace.paper())
    assert [method.name for method in chosen] == [
        "helmert-occupied", "helmert-points", "helmert-points-unweighted", "helmert-occupied-published",
        "helmert-occupied-unweighted",
    ]  # fmt: skip
    with pytest.raises(OptionError, match=r"got 'helmet'\. Did you mean"):
        study.choose_methods(["helmet"], SearchSpace.paper())
    with pytest.raises(OptionError, match="at least one method"):
        study.choose_methods([], SearchSpace.paper())


def test_methods_that_adjust_the_pose_are_named_beside_best_cells():
    space = SearchSpace.paper()
    mine = study.choose_methods(["mine"], space, {"mine": Count()})
    assert [method.name for method in mine][:2] == ["mine-occupied", "count-occupied"]

    def words(*methods):
        return study.refined_words({method.name: {"method": describe(method.method)} for method in methods})

    own = study.StudyMethod("own", MaximumConsensus(space, objective=Count()))
    maxcon, baseline = study.choose_methods(["maxcon", "icp-plane-1m"], space)
    assert words(*mine, maxcon, baseline) == words(own, maxcon, baseline) == ""
    assert words(*mine, own).startswith("own: adjusted to the map's surfaces")


def test_a_description_tells_methods_apart():
    known = study.known_methods(SearchSpace.paper())
    assert describe(known["helmert-points"].method)["objective"] == {"class": "Helmert"}
    assert describe(known["helmert-points"].method)["multiplicity"] == "points"
    assert describe(known["icp-plane-1m"].method)["gate"] == 1.0
    seen = [(str(describe(method.method)), method.map_name, method.around_reference) for method in known.values()]
    assert len(set(seen)) == len(seen)

    class Mine:
        def __init__(self):
            self.power, self._cache = 2.0, object()

    mine, count, nothing = describe([Mine(), Count(), None])
    source = mine.pop("source")
    assert mine == {"class": f"{Mine.__module__}.{Mine.__qualname__}", "power": 2.0}
    assert (count, nothing) == ({"class": "Count"}, None)
    assert len(source) == 16  # another source is another method, though its values are the same

    class Other:
        def __init__(self):
            self.power, self._cache = 3.0 - 1.0, object()

    assert describe(Other())["source"] != source


def a_row(epoch, status="localized", **values):
    plain = {"prior": "gnss", "method": "mine", "epoch": epoch, "status": status, "is_localized": False}
    return plain | {"is_success": False} | values


def test_statistics_by_hand():
    rows = [
        a_row(0, is_localized=True, is_success=True, x=1.0, distance=0.1, along=-0.1, across=0.0, heading_error=0.01,
              ms=10.0, kurtosis=4.0, n_starts=25, n_converged=25),
        a_row(1, is_localized=True, x=1.0, distance=3.0, along=3.0, across=0.0, heading_error=-0.02, ms=20.0,
              kurtosis=2.0, n_starts=25, n_converged=5),
        a_row(2, "ambiguous", is_success=True, x=1.0, distance=0.2, along=0.0, across=0.2, heading_error=0.0, ms=60.0),
        a_row(3, "unreadable scan", reason="gone"),
        a_row(0, method="other"),
    ]  # fmt: skip
    found = {rows.method: study.statistics(rows) for rows in study.rows_by_method(study_table(rows), ("other", "mine"))}
    assert list(found) == ["other", "mine"]
    mine = found["mine"]
    assert (mine.n_epochs, mine.n_success, mine.n_localized, mine.n_false) == (4, 2, 2, 1)
    assert mine.statuses == {"localized": 2, "ambiguous": 1, "unreadable scan": 1}
    assert (mine.distance.median, mine.distance.worst) == (0.2, 3.0)
    assert (mine.along.median, mine.across.worst, mine.heading_error.worst) == (0.1, 0.2, 0.02)
    assert (mine.ms.median, mine.kurtosis.median, mine.n_starts, mine.n_converged) == (20.0, 3.0, 50, 30)
    assert mine.peak_ratio.median != mine.peak_ratio.median
    assert found["other"].distance.worst != found["other"].distance.worst


def test_what_is_not_installed_is_left_out_and_named(monkeypatch):
    chosen = study.choose_methods(study.DEFAULT_SETS, SearchSpace.paper())
    assert study.installed_methods(chosen) == (chosen, [])
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    kept, missing = study.installed_methods(chosen)
    assert missing == ["gicp-1m", "gicp-3m", "count-1m-then-gicp"]
    assert [method.name for method in kept] == [method.name for method in chosen if method.name not in missing]
