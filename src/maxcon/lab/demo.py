# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The demo as a small study: a simulated dataset, its maps, and a table of answers from near and from wide priors."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from maxcon._system import Progress
from maxcon.errors import MissingExtraError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.report import check_jinja2
from maxcon.lab.simulation import PriorErrors, simulate
from maxcon.lab.simulation.scanners import check_embreex
from maxcon.lab.study.bench import Bench
from maxcon.lab.study.methods import STANDARD, StudyMethod
from maxcon.lab.study.prior_trials import (
    GICP_FROM_MANY,
    MAXCON,
    level_name,
    methods_at,
    prior_level,
    statistics_by_level,
    with_levels,
)
from maxcon.lab.study.run import spread_epochs
from maxcon.lab.study.table import MethodRows, MethodStatistics, Row, rows_by_method, table_schema
from maxcon.localizer import MaximumConsensus
from maxcon.mapping.build import build_map
from maxcon.plotting.figure import check_matplotlib
from maxcon.search.objectives import Count, Helmert
from maxcon.search.space import SearchSpace

if TYPE_CHECKING:
    import pyarrow

ANSWERS, CITY, GROUND_MAP = "answers.csv", "city.map", "city-with-ground.map"
DEMO_NAMES = ("report.html", "dataset", CITY, GROUND_MAP, ANSWERS, "pictures")  # all that the folder of a demo holds
PRIOR = "uniform"  # name of the near priors
MAPPING_WAIT = 10.0
"""The mapping vehicle stands before a red light for so long, s: the map is denser there, as real ones are."""

PAPER = SearchSpace.paper()
ALONE = partial(MaximumConsensus, PAPER, wider=0.0)  # what the objective finds by itself
COUNT_POINTS, HELMERT_POINTS, HELMERT = "Count, every map point", "Helmert, every map point", "Helmert, a voxel once"
DEMO_METHODS = {
    COUNT_POINTS: ALONE(Count(), multiplicity="points"),
    HELMERT_POINTS: ALONE(Helmert(), multiplicity="points"),
    "Count, a voxel once": ALONE(Count()),
    HELMERT: ALONE(Helmert()),
}
WIDE_LEVELS = (prior_level(3.0, 2.0), prior_level(6.0, 5.0), prior_level(12.0, 10.0))
MOST_EPOCHS = 8  # registration from many starts takes its time: of a longer drive some epochs are shown


def check_extras() -> None:
    """Say what is missing for a demo before a minute is spent on it."""
    check_embreex()
    check_matplotlib()
    check_jinja2()


def prepare_demo(folder: Path, *, n_epochs: int, seed: int, progress: Progress) -> Bench:
    """Simulate the dataset, and build its maps, with the ground and without, inside `folder`."""
    dataset = simulate(
        folder / "dataset",
        n_epochs=n_epochs,
        seed=seed,
        mapping_wait=MAPPING_WAIT,
        progress=lambda done, total: progress("simulating the city and its drives", done, total),
    )
    maps = {STANDARD: folder / CITY, "ground": folder / GROUND_MAP}
    for name, path in maps.items():
        options = dataset.map_options(keeps_ground=name == "ground")
        build_map(dataset.map_clouds, path, options, progress=progress)
    return Bench.open(dataset, maps)


@dataclass(frozen=True, slots=True)
class DemoResults:
    """What the methods answered: `near`, a method each over the whole drive; `wide`, by the level of the priors."""

    near: list[MethodRows]
    wide: dict[str, list[MethodStatistics]]

    @classmethod
    def of(cls, table: "pyarrow.Table") -> "DemoResults":
        """Return what a table of answers holds."""
        found = rows_by_method(table, tuple(DEMO_METHODS))
        return cls([rows for rows in found if rows.prior == PRIOR], statistics_by_level(table, WIDE_LEVELS))

    @property
    def widest(self) -> list[MethodStatistics]:
        """Those of the widest level, maximum consensus first."""
        return self.wide[level_name(WIDE_LEVELS[-1])]

    @property
    def wide_words(self) -> str:
        """What came out at the widest level, in plain sentences that are fair to the peers."""
        found, level = {one.method: one for one in self.widest}, WIDE_LEVELS[-1]
        ours = found.pop(MAXCON)
        one_start = [one for name, one in found.items() if "gate" in name]
        rights = sorted(one.n_success for one in one_start)
        told = (
            f"From priors wrong by up to {level.offset:g} m and {level.heading_deg:g} degrees maximum consensus is"
            f" right in {ours.n_success} of {ours.n_epochs} epochs; registration from one start in {rights[0]} to"
            f" {rights[-1]}, by method and gate, and {sum(one.n_false for one in one_start)} of its"
            f" {sum(one.n_epochs - one.n_success for one in one_start)} wrong answers call themselves good. What"
            " searches the window first can do it too: "
        )
        others = [one for one in found.values() if one not in one_start]
        fair = "; ".join(
            f"{one.method}, is right in {one.n_success}, in {one.ms.median:.0f} ms an epoch against our"
            f" {ours.ms.median:.0f}"
            for one in others
        )
        return told + (
            f"{fair}."
            if fair
            else "a coarse count followed by GICP. It needs small_gicp; to see it here: pip install 'maxcon[baselines]'"
        )


def run_demo(bench: Bench, folder: Path, *, seed: int, progress: Progress) -> DemoResults:
    """Localize the drive from near priors, some of its epochs from wide ones, and write the table into `folder`."""
    import pyarrow
    import pyarrow.csv

    near = [StudyMethod(name, method) for name, method in DEMO_METHODS.items()]
    rows = _answers(bench, PRIOR, range(len(bench.scans)), near, "localizing", progress)
    some = spread_epochs(len(bench.scans), min(len(bench.scans), MOST_EPOCHS))
    bench = with_levels(bench, WIDE_LEVELS, some, seed)
    for level in WIDE_LEVELS:
        name = level_name(level)
        rows += _answers(bench, name, some, _installed_at(level), f"localizing from priors within {name}", progress)
    table = pyarrow.Table.from_pylist(rows, schema=table_schema())
    pyarrow.csv.write_csv(table, folder / ANSWERS)
    return DemoResults.of(table)


def _answers(
    bench: Bench, prior: str, epochs: Sequence[int], methods: list[StudyMethod], step: str, progress: Progress
) -> list[Row]:
    """Rows of all epochs from one prior."""
    rows: list[Row] = []
    for done, epoch in enumerate(epochs, 1):
        rows += bench.evaluate(prior, epoch, methods)
        progress(step, done, len(epochs))
    return rows


def _installed_at(level: PriorErrors) -> list[StudyMethod]:
    """Methods of a level that can run here, without the many starts, which take too long."""
    try:
        check_small_gicp()
        left_out = GICP_FROM_MANY
    except MissingExtraError:
        left_out = "GICP"
    return [method for method in methods_at(level, gates=(1.0, 3.0)) if left_out not in method.name]
