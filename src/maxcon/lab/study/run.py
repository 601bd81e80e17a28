"""A study: methods x epochs of a dataset, on all processors, into one table; a stopped one goes on."""

import hashlib
import json
import os
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np

from maxcon._system import Progress
from maxcon._system.atomic import write_json
from maxcon._system.checked import checked, read_json
from maxcon._system.engine import Engine
from maxcon._system.regular_file import sha256_of_file
from maxcon._system.resumable import describe, differences, work_folder
from maxcon._system.version import __version__
from maxcon.drive.localize import DriveOptions
from maxcon.errors import FileError, OptionError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.bench import REFERENCE, Bench
from maxcon.lab.study.methods import MAP_VARIANTS, StudyMethod, make_maps
from maxcon.lab.study.table import Row, keys_of, table_of

if TYPE_CHECKING:
    import pyarrow

CONFIGURATION = "study.json"
LARGEST = 2**24  # bytes
MAP_AND_SCANS = "description of map and scans"


class Run(TypedDict, total=False):
    """One run of a study; rows made, and seconds, once it is done."""

    methods: list[str]
    priors: list[str]
    n_epochs: int
    n_workers: int
    n_rows: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Configuration:
    """Everything that a study was run with."""

    version: str
    dataset: str
    # Hashes of what the dataset is made of: its description of map and scans, its reference and each prior
    parts: dict[str, str]
    n_scans: int
    # Range limits of the scans, and gaps of prior and reference to interpolate across
    options: dict[str, float] = field(default_factory=dict)
    # Description of each method, by its name, in the order of the table
    methods: dict[str, dict[str, Any]] = field(default_factory=dict)
    maps: dict[str, dict[str, Any]] = field(default_factory=dict)  # how each map differs, by its name
    runs: list[Run] = field(default_factory=list)

    @classmethod
    def of(
        cls, dataset: Dataset, n_scans: int, options: DriveOptions, methods: Sequence[StudyMethod]
    ) -> "Configuration":
        """Return the configuration of a study that begins."""
        starts = {True: "around the reference", False: "from the prior"}
        described = {
            one.name: {"method": describe(one.method), "map": one.map_name, "starts": starts[one.around_reference]}
            for one in methods
        }
        built = None if dataset.map_path is None else {"path": str(dataset.map_path)}
        maps = {one.map_name: built or MAP_VARIANTS[one.map_name] for one in methods}
        parts, path = dataset_parts(dataset), str(dataset.path.resolve())
        return cls(__version__, path, parts, n_scans, describe(asdict(options)), described, maps)

    @classmethod
    def read(cls, folder: Path) -> "Configuration":
        """Return the configuration of the study in a folder; FileError if there is none."""
        what, advice = "a study", "Make one with maxcon study DATASET -o STUDY"
        path = folder / CONFIGURATION
        return checked(read_json(path, what, advice, LARGEST), cls, path, what, advice)

    def write(self, folder: Path) -> None:
        """Write it into the folder of a study."""
        write_json(folder / CONFIGURATION, asdict(self))

    def joined(self, other: "Configuration", with_rows: Collection[str]) -> "Configuration":
        """Return this configuration with a run's methods; OptionError if those `with_rows`, or their data, differ."""
        for what, mine, theirs in (
            ("made by maxcon", self.version, other.version),
            ("of a dataset with scans", self.n_scans, other.n_scans),
            ("with the options", self.options, other.options),
        ):
            if mine != theirs:
                raise OptionError(
                    f"Expected to go on with the study {what} {mine}, got {theirs}. Name another folder for a new one."
                )
        parts = self.parts if with_rows else {MAP_AND_SCANS: self.parts.get(MAP_AND_SCANS, "")}
        check_parts(parts, other.parts)
        for name in other.methods:
            if name in with_rows and self.methods.get(name) != other.methods[name]:
                raise OptionError(
                    f"Expected {name} to be made as before in this study, with"
                    f" {differences(self.methods.get(name), other.methods[name])}. Name another folder, or give your"
                    " own method another name."
                )
        kept = {name: method for name, method in self.methods.items() if name in with_rows}
        parts, maps = parts | other.parts, self.maps | other.maps
        return replace(self, dataset=other.dataset, parts=parts, methods=kept | other.methods, maps=maps)


def dataset_parts(dataset: Dataset) -> dict[str, str]:
    """Return hashes of the parts of a dataset that a study depends on; scans and clouds are too large for one."""
    described = {name: value for name, value in asdict(dataset).items() if name not in ("path", "priors")}
    inside = dataset.folder.resolve()
    words = json.dumps(described, default=lambda path: str(path.resolve()).removeprefix(str(inside)), sort_keys=True)
    files = {"reference": dataset.reference, **{f"prior {name}": path for name, path in dataset.priors.items()}}
    try:
        checksums = {name: sha256_of_file(path) for name, path in files.items()}
    except OSError as error:
        raise FileError(
            f"Expected to be able to read {error.filename}, got: {error.strerror}. Check it and its permissions."
        ) from error
    return {MAP_AND_SCANS: hashlib.sha256(words.encode()).hexdigest(), **checksums}


def check_parts(mine: Mapping[str, str], theirs: Mapping[str, str]) -> None:
    """Refuse a dataset whose parts are not those of a study; other priors may come."""
    for name in mine.keys() & theirs.keys():
        if mine[name] != theirs[name]:
            raise OptionError(
                f"Expected the {name} of the dataset to be as before in this study, but it has changed."
                " Name another folder for a new study."
            )


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A study on disk."""

    folder: Path  # holds study.json, table.parquet and maps/
    configuration: Configuration  # what it was run with
    table: "pyarrow.Table"  # a row per epoch, method and prior (`COLUMNS`)

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> "Study":
        """Open a study, done or not; FileError if there is none."""
        root = Path(folder)
        return cls(root, Configuration.read(root), table_of(root).read())


class StudyTask(NamedTuple):
    """An epoch from one prior, and the names of the methods that are to answer it: a row each."""

    prior: str
    epoch: int
    methods: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StudyJob:
    """The work on a `StudyTask`: rows of the table. Each process keeps the methods, and what they keep of the map."""

    dataset: Dataset
    maps: dict[str, Path]
    options: DriveOptions
    methods: tuple[StudyMethod, ...]

    def bench(self) -> Bench:
        """Open dataset and maps."""
        return Bench.open(self.dataset, self.maps, self.options)

    def open(self) -> Callable[[StudyTask], list[Row]]:
        """Open dataset and maps, load what is compiled, and return the function that does a task."""
        from maxcon.localizer import MaximumConsensus
        from maxcon.warmup import SPACE, search_room

        bench, known = self.bench(), {method.name: method for method in self.methods}
        search_room(  # what is compiled is not charged to the first epoch
            MaximumConsensus(SPACE, multiplicity=multiplicity, search="exhaustive")
            for multiplicity in ("points", "occupied")
        )

        def answer(task: StudyTask) -> list[Row]:
            return bench.evaluate(task.prior, task.epoch, [known[name] for name in task.methods])

        return answer

    def split(self, task: StudyTask) -> Sequence[StudyTask]:
        """Return a task for each row."""
        return [StudyTask(task.prior, task.epoch, (method,)) for method in task.methods]

    def lost(self, task: StudyTask, reason: str) -> list[Row]:
        """Return the rows of a task whose worker ended before it was done, with the reason."""
        methods = [method for method in self.methods if method.name in task.methods]
        return self.bench().failed(task.prior, task.epoch, methods, reason)


def run_study(
    dataset: Dataset, folder: str | os.PathLike[str], methods: Sequence[StudyMethod], *,
    priors: Sequence[str] | None = None, n_epochs: int | None = None, n_workers: int | None = None,
    options: DriveOptions | None = None, progress: Progress | None = None, scheduler: str | None = None,
    warn: Callable[[str], None] | None = None,
) -> Study:  # fmt: skip
    """Let methods localize evenly spread epochs of a dataset; rows that are in the folder already are not made again.

    All priors of the dataset if None, or "reference" among them. `n_workers` processes (all processors if None), or a
    dask `scheduler`, for which `warn` gets a line while it is waited for; `progress`: (step, done, of how many).
    """
    root, options, report = Path(folder), options or DriveOptions(), progress or (lambda step, done, total: None)
    engine = Engine(n_workers, scheduler, warn)
    names = _checked(dataset, methods, priors)
    n_scans = len(dataset.open_scans())
    numbers = spread_epochs(n_scans, n_epochs)
    with work_folder(root, "a study", CONFIGURATION):
        table = table_of(root)
        done = set(keys_of(table.read()))
        configuration = Configuration.of(dataset, n_scans, options, methods)
        if (root / CONFIGURATION).exists():
            configuration = Configuration.read(root).joined(configuration, {method for _, method, _ in done})
        else:
            configuration.write(root)
        maps = make_maps(dataset, root / "maps", [method.map_name for method in methods], progress)
        job = StudyJob(dataset, maps, options, tuple(methods))
        job.bench().check_times(names, numbers)  # what concerns all epochs is raised here, not in a worker
        lacking = {
            (prior, number): tuple(one.name for one in methods if (prior, one.name, number) not in done)
            for prior in names
            for number in numbers
        }
        tasks = [StudyTask(*place, missing) for place, missing in lacking.items() if missing]
        run = Run(methods=[method.name for method in methods], priors=names, n_epochs=len(numbers))
        run["n_workers"] = engine.n_local(len(tasks))
        if tasks:
            configuration = replace(configuration, runs=[*configuration.runs, run])
        configuration.write(root)
        if tasks:
            started, n_done, n_total = time.perf_counter(), 0, sum(len(task.methods) for task in tasks)
            report("localizing", 0, n_total)
            for _, rows in engine.run(job, tasks, len(tasks)):
                table.add(rows)
                n_done += len(rows)
                report("localizing", n_done, n_total)
            run["n_rows"], run["seconds"] = n_done, round(time.perf_counter() - started, 1)
            configuration.write(root)
        return Study(root, configuration, table.merge())


def spread_epochs(n_scans: int, n_epochs: int | None) -> list[int]:
    """Return `n_epochs` of the numbers of `n_scans` scans, evenly spread; all if None."""
    if n_epochs is None:
        return list(range(n_scans))
    if not 1 <= n_epochs <= n_scans:
        raise OptionError(f"Expected 1 to {n_scans} epochs, as the dataset has, got {n_epochs}. Take fewer.")
    return [int(number) for number in np.linspace(0, n_scans - 1, n_epochs).round()]


def _checked(dataset: Dataset, methods: Sequence[StudyMethod], priors: Sequence[str] | None) -> list[str]:
    """Return the names of the priors; refuse what is not there, before anything is made."""
    names = list(dict.fromkeys(dataset.priors if priors is None else priors))
    for name in names:
        if name not in (*dataset.priors, REFERENCE):
            raise OptionError(
                f"Expected a prior of {', '.join(dataset.priors)}, as {dataset.path} names them, or {REFERENCE}, got"
                f" {name!r}."
            )
    if not methods or len({method.name for method in methods}) < len(methods):
        raise OptionError("Expected at least one method, each with a name of its own. Rename one.")
    for method in methods:
        if method.needs_small_gicp:
            check_small_gicp()
    return names
