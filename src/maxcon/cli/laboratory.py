"""`maxcon simulate`, `demo`, `study` and `report`: the commands of the laboratory."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from maxcon.cli.flags import OptionGroup, argument, check_exclusive, check_needs, flag, flags
from maxcon.cli.options import Quiet, RangeOptions, WorkerOptions
from maxcon.cli.terminal import compiling_told, print_rows, step_bars, warn

if TYPE_CHECKING:
    from maxcon.lab.dataset import Dataset
    from maxcon.lab.demo import DemoResults
    from maxcon.lab.study import MethodStatistics, Study


class Simulated(OptionGroup):
    """What is simulated.

    scanner: The car's scanner: vlp-16 (default), vlp-32c, hdl-64e, os1-64, os1-128, os-dome-128, xt-32, pandar-128; not
        repetitive: mid-360, avia; one on either side: two-vlp-16, two-os-dome-128.
    carrier: Hand: walked through the city, 1 to 2 m high, tilted by up to 20 degrees; priors are level.
    every: With --campaign: seconds between scans from its beginning on; else spread evenly.
    changed: In a city: months between map and scans change such a part of it (bare trees, scaffolds, demolished houses,
        fences, snow, roads 5 cm higher), 0 to 1. Parked cars always change.
    recording: Also record scans and latitudes, longitudes: ROS 1 bag, MCAP (extra recordings).
    """

    out: Path = argument(..., "Folder of the dataset to write.", "OUT")
    campaign: bool = flag(False, "A circuit mapped in five rounds, and a round of up to 3001 scans.")
    hard: bool = flag(False, "With --campaign: periodic facades, things gone, 30 % unmapped returns.")
    scene: Literal["city", "suburb"] = flag("city", "A city, or a suburb: hedges, gardens, slopes, a moving scanner.")
    scanner: str | None = flag(None, metavar="NAME")
    carrier: Literal["car", "hand"] = flag("car")
    epochs: int | None = flag(None, "How many scans; 40, 3001 with --campaign, 200 in a suburb.", min=1)
    every: float | None = flag(None, metavar="S")
    changed: float = flag(0.0, min=0.0, max=1.0, metavar="SHARE")
    seed: int = flag(0, "The same seed gives the same dataset.", min=0)
    recording: Literal["bag", "mcap"] | None = flag(None, metavar="bag|mcap")
    overwrite: bool = flag(False, "Replace the folder if there is one.")

    def __post_init__(self) -> None:
        check_needs({"--hard": self.hard, "--every": self.every}, {"--campaign": self.campaign})
        scene, carrier = {f"--scene {self.scene}": self.scene != "city"}, {"--carrier hand": self.carrier == "hand"}
        check_exclusive({"--campaign": self.campaign}, scene, carrier)
        check_exclusive({"--changed": self.changed > 0.0}, scene | {"--hard": self.hard})


@flags
def simulate(what: Simulated, quiet: Quiet = False) -> None:
    """Simulate a city or a suburb: map clouds (LAZ), scans, reference and priors (TUM). Needs the extra demo."""
    from maxcon.lab import simulation

    if what.recording is not None:
        from maxcon.io.recordings.recording import check_writers

        check_writers()
    options: dict[str, Any] = {"seed": what.seed, "overwrite": what.overwrite}
    if what.scanner is not None:
        options["scanner"] = simulation.ScannerLayout.parse(what.scanner).scanner()
    if what.changed:
        options["changed"] = what.changed
    with step_bars(quiet) as report:
        options["progress"] = lambda done, total: report("simulating", done, total)
        if what.campaign:
            options |= {"every": what.every, "is_hard": what.hard}
            dataset = simulation.simulate_campaign(what.out, n_epochs=what.epochs or 3001, **options)
        elif what.scene == "suburb":
            dataset = simulation.simulate_suburb(what.out, n_epochs=what.epochs or 200, **options)
        else:
            options["carrier"] = simulation.Carrier(what.carrier)
            dataset = simulation.simulate(what.out, n_epochs=what.epochs or 40, **options)
    _print_parts(dataset)
    if what.recording is not None:
        from maxcon.io.recordings.recording import RecordingKind
        from maxcon.lab.simulation.recordings import record_dataset

        print_rows([("recording", str(record_dataset(dataset, RecordingKind(what.recording))))])


def _print_parts(dataset: "Dataset") -> None:
    """Name the parts of a dataset, one per line; a prior has its name where there are several."""
    typer.echo(f"{dataset.folder}")
    clouds = f"{dataset.map_clouds[0].parent}/*.laz ({len(dataset.map_clouds)} files, vehicles are class 64)"
    is_only, sigma = len(dataset.priors) == 1, dataset.map_sigma
    parts = {
        "map clouds": clouds, "mapping": dataset.map_trajectory,
        "map sigma": None if sigma is None else f"{sigma:g} m (map build --sigma {sigma:g})",
        "scans": dataset.scans, "reference": dataset.reference,
        **{"prior" if is_only else f"prior {name}": path for name, path in dataset.priors.items()},
        "odometry": dataset.odometry,
        "changed": None if dataset.changed is None else f"{dataset.changed:.0%} of the returns, since the map",
    }  # fmt: skip
    print_rows((name, str(part)) for name, part in parts.items() if part is not None)


class DemoOptions(OptionGroup):
    """What the demo makes."""

    out: Path = flag(Path("maxcon-demo"), "Folder for everything the demo makes.", metavar="DIR")
    epochs: int = flag(40, "How many scans.", min=1)
    seed: int = flag(0, "The same seed gives the same answers.", min=0)
    quiet: bool = flag(False, "No progress bars.", "--quiet", "-q")


@flags
def demo(how: DemoOptions) -> None:
    """Simulate a small city, map it, drive it, localize from near and from wide priors, and report.

    Needs the extra demo. A demo that stands in DIR is replaced; anything else there is an error.
    """
    from maxcon._system.atomic import atomic_folder, check_replaceable
    from maxcon.lab import demo as lab

    lab.check_extras()
    check_replaceable(how.out, "a demo", lab.DEMO_NAMES)
    with (
        step_bars(how.quiet, has_lines=True) as progress,
        compiling_told(how.quiet),
        atomic_folder(how.out, overwrite=True) as folder,
    ):
        bench = lab.prepare_demo(folder, n_epochs=how.epochs, seed=how.seed, progress=progress)
        results = lab.run_demo(bench, folder, seed=how.seed, progress=progress)
        lab.report_demo(folder, bench, results, seed=how.seed, progress=progress)
    _print_demo(results)
    typer.echo(f"\nThe report with pictures: {how.out / 'report.html'}")


def _print_demo(results: "DemoResults") -> None:
    from rich.console import Console
    from rich.table import Table

    from maxcon.lab.study import statistics

    near = Table(title="Within 0.3 m and 1 degree of the reference, from priors wrong by up to 2.5 m and 1.8 degrees")
    widest = results.widest[0].prior.replace("°", " degrees").replace(", ", " and ")
    wide = Table(title=f"The same, from priors wrong by up to {widest}, beside registration")
    for table, names in (
        (near, ("success", "median m", "worst m", "worst deg", "ms per epoch")),
        (wide, ("success", "wrong, but reported as good", "median ms")),
    ):
        table.add_column("method")
        for name in names:
            table.add_column(name, justify="right")
    for of in map(statistics, results.near):
        far, turned = f"{of.distance.worst:.3f}", f"{math.degrees(of.heading_error.worst):.2f}"
        success = f"{of.n_success} of {of.n_epochs}"
        near.add_row(of.method, success, f"{of.distance.median:.3f}", far, turned, f"{of.ms.median:.0f}")
    for of in results.widest:
        wide.add_row(of.method, f"{of.n_success} of {of.n_epochs}", str(of.n_false), f"{of.ms.median:.0f}")
    Console().print(near)
    Console().print("", wide)
    Console(soft_wrap=True).print(results.wide_words, markup=False, highlight=False)


class StudyOptions(OptionGroup, title="Inputs"):
    """What is studied, and where.

    methods: Names of methods and sets (consensus, baselines, ground, weights, thinning, cells, density), and objectives
        of your own, package.module:Name, each beside ours. Default: consensus,baselines; without those whose packages
        are not installed.
    prior: Prior of the dataset, or reference; repeatable. Default: all of the dataset.
    max_gap: Largest gap in prior and reference to interpolate across.
    """

    dataset: Path = argument(..., "Folder with a dataset.toml, or such a file.", "DATASET")
    out: Path = flag(..., "Folder; a study there goes on.", "--out", "-o", metavar="STUDY", rich_help_panel="Output")
    methods: str | None = flag(None, metavar="LIST", rich_help_panel="Method")
    prior: list[str] | None = flag(None, metavar="NAME")
    max_gap: float = flag(0.5, metavar="S")
    epochs: int | None = flag(None, "So many scans, evenly spread. Default: all.", metavar="N", min=1)


class StudySpace(OptionGroup, title="Search space"):
    """Where each method searches."""

    half_width: float = flag(3.0, "Largest offset from the prior in x and y, m.", metavar="M")
    heading_half_width_deg: float = flag(2.0, "Largest turn from the prior's heading, degrees.", metavar="DEG")
    heading_step_deg: float = flag(0.5, "Step between headings, degrees.", metavar="DEG")


@flags
def study(
    what: StudyOptions, ranges: RangeOptions, space: StudySpace, worker: WorkerOptions, quiet: Quiet = False
) -> None:
    """Compare methods over the epochs of a dataset: one table, a row per epoch and method.

    Stopped or killed, the same command goes on; with other methods, priors or epochs it adds to the table.
    """
    from maxcon.cli.drive_inputs import parse_objective
    from maxcon.drive.localize import DriveOptions
    from maxcon.lab.dataset import Dataset
    from maxcon.lab.study import DEFAULT_SETS, choose_methods, installed_methods, run_study
    from maxcon.lab.study.methods import CELL
    from maxcon.map.manifest import read_manifest
    from maxcon.search.space import SearchSpace

    opened = Dataset.open(what.dataset)
    cell = CELL if opened.map_path is None else read_manifest(opened.map_path).cell  # as the standard map will have
    searched = SearchSpace(space.half_width, cell, space.heading_half_width_deg, space.heading_step_deg)
    listed = what.methods
    names = DEFAULT_SETS if listed is None else [name.strip() for name in listed.split(",") if name.strip()]
    objectives = {name: parse_objective(name) for name in names if ":" in name}
    chosen = choose_methods(names, searched, objectives)
    if listed is None:
        chosen, missing = installed_methods(chosen)
        if missing:
            typer.echo(f"without {', '.join(missing)}: pip install 'maxcon[baselines]'")
    with step_bars(quiet) as report:
        done = run_study(
            opened, what.out, chosen, priors=what.prior, n_epochs=what.epochs, n_workers=worker.workers,
            options=DriveOptions(ranges.min_range, ranges.max_range, what.max_gap), progress=report,
            scheduler=worker.scheduler, warn=warn,
        )  # fmt: skip
    _print_study(done, "".join(f" --objective {name}" for name in [*objectives][:1]))


_NO_ANSWER = ("unreadable scan", "failed", "no prior", "no points", "no match", "outside the map")


def _print_study(done: "Study", drawn: str) -> None:
    from maxcon.lab.study import refined_words, rows_by_method, statistics

    found = [statistics(rows) for rows in rows_by_method(done.table, tuple(done.configuration.methods))]
    width = max(len(method.method) for method in found)
    for number, method in enumerate(found):
        if number == 0 or method.prior != found[number - 1].prior:
            typer.echo(f"prior {method.prior}")
            typer.echo(f"  {'method':<{width}}   success    trusted  wrong  median m  worst m      ms")
        typer.echo(f"  {method.method:<{width}} {_numbers(method)}")
        others = {status: n for status, n in method.statuses.items() if status in _NO_ANSWER}
        if others:
            typer.echo(f"  {'':<{width}}   " + ", ".join(f"{n} {status}" for status, n in others.items()))
    failed = done.table.column("status").to_pylist()
    if "failed" in failed:
        typer.echo(f"the first that failed: {done.table.column('reason')[failed.index('failed')]}")
    typer.echo(f"{len(done.table):,} rows in {done.folder / 'table.parquet'}")
    if words := refined_words(done.configuration.methods):
        typer.echo(words)
    typer.echo(f"page         maxcon report {done.folder} -o report.html{drawn}")


def _numbers(method: "MethodStatistics") -> str:
    def shown(value: float, digits: int) -> str:
        return "-" if math.isnan(value) else f"{value:.{digits}f}"

    return (
        f"{f'{method.n_success}/{method.n_epochs}':>10} {method.n_localized:>9} {method.n_false:>6}"
        f" {shown(method.distance.median, 3):>9} {shown(method.distance.worst, 2):>8} {shown(method.ms.median, 0):>7}"
    )


class ReportOptions(OptionGroup):
    """What is reported, and where."""

    study: Path = argument(..., "Folder made by `maxcon study`.", "STUDY")
    out: Path = flag(..., "Page to write.", "--out", "-o", metavar="REPORT.html")
    figures: Path | None = flag(None, "Folder of figures, SVG. Default: REPORT-figures beside the page.", metavar="DIR")
    dataset: Path | None = flag(None, "Where the dataset is now, if it was moved.", metavar="DATASET")
    prior: str | None = flag(None, "Prior that figures and claims are about. Default: the first.", metavar="NAME")
    objective: str | None = flag(None, "Your own, drawn beside count and Helmert's score.", metavar="MODULE:NAME")


@flags
def report(what: ReportOptions, quiet: Quiet = False) -> None:
    """Write the page of a study: claims, tables and figures in one file. Needs the extra demo."""
    from maxcon.cli.drive_inputs import parse_objective
    from maxcon.lab.report.study_report import report_study

    objective = None if what.objective is None else parse_objective(what.objective)
    with step_bars(quiet) as tell:
        folder = report_study(
            what.study, what.out, figures=what.figures, dataset=what.dataset, prior=what.prior, objective=objective,
            progress=tell,
        )  # fmt: skip
    typer.echo(f"{what.out}")
    typer.echo(f"figures      {folder}")
