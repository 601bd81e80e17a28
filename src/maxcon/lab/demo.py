"""The demo: a small study of a simulated dataset, from near and from wide priors, and the page that shows it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maxcon._system import Progress
from maxcon._system.atomic import make_folder
from maxcon._system.version import __version__
from maxcon.errors import MissingExtraError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.report import Picture, check_jinja2, write_page
from maxcon.lab.report.charts import plot_error_distributions
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.report.study_scenes import Scenes
from maxcon.lab.simulation import PriorErrors, simulate
from maxcon.lab.simulation.datasets import CITY_ORIGIN
from maxcon.lab.simulation.scanners import check_embreex
from maxcon.lab.study import prior_trials
from maxcon.lab.study.bench import Bench
from maxcon.lab.study.methods import STANDARD, StudyMethod
from maxcon.lab.study.run import spread_epochs
from maxcon.lab.study.table import MethodRows, MethodStatistics, Row, rows_by_method, statistics, table_schema
from maxcon.localizer import MaximumConsensus
from maxcon.mapping.build import build_map
from maxcon.plotting import plot_drive
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
WIDE_LEVELS = tuple(prior_trials.prior_level(*each) for each in ((3.0, 2.0), (6.0, 5.0), (12.0, 10.0)))
STREET_PART = 0.25  # of the whole drive: well before the crossing, in the straight part of the street
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
        near = [rows for rows in found if rows.prior == PRIOR]
        return cls(near, prior_trials.statistics_by_level(table, WIDE_LEVELS))

    @property
    def widest(self) -> list[MethodStatistics]:
        """Those of the widest level, maximum consensus first."""
        return self.wide[prior_trials.level_name(WIDE_LEVELS[-1])]

    @property
    def wide_words(self) -> str:
        """What came out at the widest level, in plain sentences that are fair to the peers."""
        found, level = {one.method: one for one in self.widest}, WIDE_LEVELS[-1]
        ours = found.pop(prior_trials.MAXCON)
        one_start = [one for name, one in found.items() if "gate" in name]
        rights = sorted(one.n_success for one in one_start)
        others = "; ".join(
            f"{name}, is right in {one.n_success}, in {one.ms.median:.0f} ms an epoch against our {ours.ms.median:.0f}"
            for name, one in found.items()
            if "gate" not in name
        )
        lacking = (
            "a coarse count followed by GICP. It needs small_gicp; to see it here: pip install 'maxcon[baselines]'."
        )
        return (
            f"From priors wrong by up to {level.offset:g} m and {level.heading_deg:g} degrees maximum consensus is"
            f" right in {ours.n_success} of {ours.n_epochs} epochs; registration from one start in {rights[0]} to"
            f" {rights[-1]}, by method and gate, and {sum(one.n_false for one in one_start)} of its"
            f" {sum(one.n_epochs - one.n_success for one in one_start)} wrong answers call themselves good. What"
            f" searches the window first can do it too: {others + '.' if others else lacking}"
        )


def run_demo(bench: Bench, folder: Path, *, seed: int, progress: Progress) -> DemoResults:
    """Localize the drive from near priors, some of its epochs from wide ones, and write the table into `folder`."""
    import pyarrow
    import pyarrow.csv

    near = [StudyMethod(name, method) for name, method in DEMO_METHODS.items()]
    rows = _answers(bench, PRIOR, range(len(bench.scans)), near, "localizing", progress)
    some = spread_epochs(len(bench.scans), min(len(bench.scans), MOST_EPOCHS))
    bench = prior_trials.with_levels(bench, WIDE_LEVELS, some, seed)
    for level in WIDE_LEVELS:
        name = prior_trials.level_name(level)
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
        left_out = prior_trials.GICP_FROM_MANY
    except MissingExtraError:
        left_out = "GICP"
    return [method for method in prior_trials.methods_at(level, gates=(1.0, 3.0)) if left_out not in method.name]


def report_demo(folder: Path, bench: Bench, results: DemoResults, *, seed: int, progress: Progress) -> Path:
    """Draw the pictures and write `report.html` into `folder`; return its path."""
    n_epochs = len(bench.scans)
    make_folder(folder / "pictures")
    pictures = DemoPictures(folder / "pictures", bench, results)
    steps: dict[str, Callable[[], Picture]] = {
        "why": pictures.why, "wide": pictures.wide_priors, "errors": pictures.errors,
        "drive": pictures.drive_from_above, "epoch": pictures.epoch, "spaces": pictures.street_and_crossing,
    }  # fmt: skip
    drawn = {}
    for number, (name, step) in enumerate(steps.items(), 1):
        drawn[name] = step()
        progress("drawing", number, len(steps))
    path, found = folder / "report.html", [statistics(rows) for rows in results.near]
    page = {
        "title": "maxcon demo: a simulated street", "methods": DEMO_METHODS, "results": found, **drawn,
        "space": DEMO_METHODS[HELMERT].space, "n_tiles": len(bench.maps[STANDARD].tile_keys), "n_scans": n_epochs,
        "command": f"maxcon demo --epochs {n_epochs} --seed {seed}", "version": __version__, "seed": seed,
    }  # fmt: skip
    write_page(path, "demo.html.j2", page)
    return path


class DemoPictures:
    """Pictures of the demo's page with their captions, drawn into a folder; epochs are searched again for them."""

    def __init__(self, folder: Path, bench: Bench, results: DemoResults) -> None:
        self.folder, self.results = folder, results
        self.near = {rows.method: rows for rows in results.near}
        self.distances = {name: rows.numbers("distance") for name, rows in self.near.items()}
        self.scenes = Scenes(bench, PRIOR, bench.maps[STANDARD], DEMO_METHODS[HELMERT])
        self.street = int(STREET_PART * (len(bench.scans) - 1))
        # Where the car was at each epoch, shape (n, 2), local frame, m.
        self.places = np.array([self.scenes.poses(epoch)[1].position[:2] for epoch in range(len(bench.scans))])

    def why(self) -> Picture:
        """Draw the epoch that the count puts farthest off, and say what came out, whatever it is."""
        epoch = worst_of_the_count(self.near[COUNT_POINTS], self.near[HELMERT_POINTS])
        title = "Why Helmert's point error, and a voxel once"
        path = self._compared("why", title, {"uneven map": epoch})
        off = {name: distances[epoch] for name, distances in self.distances.items()}
        found = [statistics(rows) for rows in self.results.near]
        wrong = "; ".join(f"{one.method}: {one.n_epochs - one.n_success}" for one in found)
        return Picture.of(
            "demo-why", path, wait=MAPPING_WAIT, epoch=epoch, count=off[COUNT_POINTS], helmert=off[HELMERT_POINTS],
            once=off[HELMERT], n_epochs=found[0].n_epochs, wrong=wrong,
        )  # fmt: skip

    def wide_priors(self) -> Picture:
        """Draw what wide priors make of each method."""
        path = self.folder / "prior_error.svg"
        plot_prior_error(path, {f"the simulated street, {self.results.widest[0].n_epochs} epochs": self.results.wide})
        return Picture.of("demo-wide", path, words=self.results.wide_words)

    def errors(self) -> Picture:
        """Draw the errors of all methods."""
        return plot_error_distributions(self.folder / "errors.svg", self.distances)

    def drive_from_above(self) -> Picture:
        """Draw the drive by the default method."""
        path = self.folder / "drive.png"
        plot_drive(path, self.places, self.distances[HELMERT], point_map=self.scenes.point_map)
        return Picture.of("demo-drive", path, method=HELMERT)

    def epoch(self) -> Picture:
        """Draw the search space of an epoch, and its scene."""
        path = self.folder / "epoch.png"
        self.scenes.draw_epoch(path, self.street, f"Epoch {self.street}, in the street: {HELMERT}")
        return Picture.of("demo-epoch", path)

    def street_and_crossing(self) -> Picture:
        """Draw the count beside Helmert, on the same matches, in the street and at the crossing."""
        middle = self.scenes.point_map.frame.to_local([CITY_ORIGIN])[0]
        crossing = int(np.argmin(np.linalg.norm(self.places - middle[:2], axis=1)))
        epochs = {"in the street": self.street, "at the crossing": crossing}
        return Picture.of("demo-spaces", self._compared("street-and-crossing", "Count beside Helmert", epochs))

    def _compared(self, stem: str, title: str, epochs: dict[str, int]) -> Path:
        """Draw epochs by the paper's two methods and the default."""
        path = self.folder / f"{stem}.png"
        methods = [(name, DEMO_METHODS[name]) for name in (COUNT_POINTS, HELMERT_POINTS, HELMERT)]
        self.scenes.compare(path, epochs, methods, title)
        return path


def worst_of_the_count(count: MethodRows, helmert: MethodRows) -> int:
    """Return the epoch that the count puts farthest off where Helmert's score of the same is right, or of all."""
    distances = count.numbers("distance")
    is_shown = ~np.isnan(distances) & (count.numbers("is_success") == 0.0) & (helmert.numbers("is_success") == 1.0)
    return int(np.nanargmax(np.where(is_shown, distances, np.nan) if is_shown.any() else distances))
