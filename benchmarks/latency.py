# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long does one epoch take on one core, end to end and by stage, and how long do registrations of the same scan?

python benchmarks/latency.py STUDY [STUDY ...] [--epochs 40] [--out docs/images/latency.svg] [--page docs/latency.md]

Epochs spread evenly over the drive of each study, around the prior it was made with. Round after round goes over the
whole drive; the first one compiles and reads the tiles and is not counted. Of the rounds' times each epoch keeps the
median; p50, p95 and p99 are taken over the epochs. They are of time on the processor, which others on the machine
disturb least; the wall's clock stands beside it, and on an idle machine says the same. Registrations (small_gicp, and
our ICP) start once, at the prior; their part of the map is ready before the clock runs. The tables are printed and put
into the page, between its marks.
"""

import argparse
import os
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from latency_plot import plot
from scene import header

import maxcon
from maxcon import Estimate, MaximumConsensus, PointMap, Scan, SearchSpace
from maxcon.baselines import Gicp, Icp, MapTargets
from maxcon.baselines.place import Place
from maxcon.baselines.thinning import thin
from maxcon.dataset import Dataset
from maxcon.drive import DriveOptions
from maxcon.evaluation import pose_error
from maxcon.geometry import Pose
from maxcon.search import exhaustive
from maxcon.study import Study
from maxcon.study.bench import Bench, BenchPlan
from maxcon.study.run import spread_epochs

SPACE = SearchSpace()
OPTIONS = DriveOptions()
# By branch and bound but for the first. What is found is an Accumulator, or an Estimate if there is nothing left to
# conclude. A thinned scan is kept with the scan: its stage is timed before.
SEARCHES: dict[str, Callable[[Scan, PointMap, Pose, SearchSpace], maxcon.Accumulator | Estimate]] = {
    "exhaustive": lambda scan, point_map, prior, space: maxcon.MaximumConsensus(space).accumulate(
        scan, point_map, prior
    ),
    "branch and bound": lambda scan, point_map, prior, space: maxcon.MaximumConsensus(space).localize(
        scan, point_map, prior
    ),
    "whole scan": lambda scan, point_map, prior, space: maxcon.MaximumConsensus(space, thinning=0.0).localize(
        scan, point_map, prior
    ),
    "as published": lambda scan, point_map, prior, space: maxcon.MaximumConsensus(
        space, weighting="published", thinning=0.0
    ).localize(scan, point_map, prior),
}
FIRST = next(iter(SEARCHES))
WITHOUT_THINNING = ("whole scan", "as published")
GATE, THINNING = 3.0, 0.75
N_ROUNDS = 3
CACHE_BYTES = 2**33
PROCESSOR, WALL = 0, 1
PERCENTILES = (50, 95, 99)
DENSITIES = {"density-1-4": "map of every 4th point", "density-1-16": "map of every 16th point"}
BEGIN, END = "<!-- measured -->", "<!-- until here -->"
DOCS = Path(__file__).parents[1] / "docs"


@dataclass(frozen=True)
class Drive:
    """A study's scans, priors and maps, and the epochs that are timed."""

    name: str
    bench: Bench
    prior_name: str
    epochs: list[int]

    @classmethod
    def of_study(cls, folder, n_epochs):
        """Open a study; of maps besides the standard one those of fewer points, if it has them."""
        study = Study.open(folder)
        dataset = Dataset.open(study.configuration.dataset)
        maps = {"standard": dataset.map_path or study.folder / "maps" / "standard.map"}
        others = {name: study.folder / "maps" / f"{name}.map" for name in DENSITIES}
        maps |= {name: path for name, path in others.items() if path.exists()}
        # Round after round over the whole drive: all its tiles stay, with what searches derive from them.
        kept = {name: PointMap.open(path, cache_bytes=CACHE_BYTES) for name, path in maps.items()}
        bench = replace(BenchPlan(dataset, maps).open(), maps=kept)
        prior_name = study.table["prior"][0].as_py()
        return cls(Path(folder).stem, bench, prior_name, spread_epochs(len(bench.scans), n_epochs))

    @property
    def point_map(self):
        """The standard map."""
        return self.bench.maps["standard"]

    def scan(self, epoch):
        """Points within range, checked; without normals yet."""
        return Scan(self.bench.scans.read(epoch, OPTIONS.min_range, OPTIONS.max_range).points)

    def prior(self, epoch, map_name="standard"):
        """In the frame of a map."""
        prior = self.bench.priors[self.prior_name].at(float(self.bench.scans.times[epoch]))
        return self.bench.maps[map_name].frame.pose_to_local(prior)

    def reference(self, epoch):
        """In the frame of the standard map."""
        reference = self.bench.reference.at(float(self.bench.scans.times[epoch]))
        return self.point_map.frame.pose_to_local(reference)


class Times:
    """Milliseconds of calls by what they are for, round after round over the same epochs.

    Both on the wall's clock and on the processor: where others use the machine too, a call waits for it.
    """

    def __init__(self):
        self._taken = defaultdict(list)

    def __call__(self, stage, function, *arguments):
        """Call a function, note how long it takes, and return its result."""
        start = time.process_time(), time.perf_counter()
        result = function(*arguments)
        end = time.process_time(), time.perf_counter()
        self._taken[stage].append(1e3 * np.subtract(end, start))
        return result

    def of(self, *stages, clock=PROCESSOR):
        """Time of each epoch for some stages together: the median of the rounds, without the first."""
        return np.median(sum(self._rounds(stage, clock) for stage in stages), axis=0)

    def largest(self, *stages):
        """Longest single run of some stages together."""
        return sum(self._rounds(stage, PROCESSOR) for stage in stages).max()

    def _rounds(self, stage, clock):
        return np.reshape(self._taken[stage], (N_ROUNDS + 1, -1, 2))[1:, :, clock]


@dataclass(frozen=True)
class PlaneIcpOfSmallGicp:
    """Point-to-plane of small_gicp, with everything else as `Gicp` has it. For its time alone.

    Its factor squares the element-wise product of normal and residual, which is point-to-plane only at walls along
    the axes: it takes as long as the right one, but its answers are not those of point-to-plane ICP.
    """

    like: Gicp

    def prepare(self, scan, point_map, around):
        """Thin the scan; the map around it is made once and kept."""
        import small_gicp

        place = Place.of_scan(scan.points, around, self.like.gate, 0.0)
        target = self.like.targets.get(point_map, ("planes", place), lambda: self._target(point_map, place))
        return _PlaneAligner(self.like, small_gicp.PointCloud(thin(scan.points, self.like.thinning)), *target)

    def _target(self, point_map, place):
        import small_gicp

        origin = np.array([*place.middle, 0.0])
        points, _ = self.like.targets.planes(point_map, place, self.like.target_edge)
        cloud = small_gicp.PointCloud(points - origin)
        tree = small_gicp.KdTree(cloud)
        small_gicp.estimate_normals(cloud, tree, num_neighbors=self.like.n_neighbours)
        return cloud, tree, origin


@dataclass(frozen=True)
class _PlaneAligner:
    like: Gicp
    source: object
    target: object
    tree: object
    origin: np.ndarray

    def align(self, start):
        import small_gicp

        T_target_source = np.eye(4)
        T_target_source[:3, :3] = start.rotation
        T_target_source[:3, 3] = start.position - self.origin
        small_gicp.align(
            self.target, self.source, self.tree, T_target_source, registration_type="PLANE_ICP",
            max_correspondence_distance=self.like.gate, num_threads=1, max_iterations=self.like.max_iterations,
            rotation_epsilon=self.like.turn_tolerance, translation_epsilon=self.like.step_tolerance,
        )  # fmt: skip


def registrations():
    """Methods by name: `prepare(scan, point_map, prior).align(prior)`."""
    targets = MapTargets()
    gicp = Gicp(gate=GATE, thinning=THINNING, targets=targets)
    return {
        "small_gicp point-to-plane": PlaneIcpOfSmallGicp(gicp),
        "small_gicp GICP": gicp,
        "small_gicp GICP, finer scan": Gicp(gate=GATE, thinning=0.25, targets=targets),
        "our ICP, point-to-plane": Icp("plane", gate=GATE, thinning=THINNING, targets=targets),
    }


class Measured:
    """Times of all stages of a drive, and how often each method was right."""

    def __init__(self, drive):
        self.drive, self.times, self.n_right = drive, Times(), defaultdict(int)
        self.methods, self.concluded = registrations(), set()
        clocks = time.perf_counter(), time.process_time()
        for turn in range(N_ROUNDS + 1):
            if turn == 1:
                clocks = time.perf_counter(), time.process_time()
            for epoch in drive.epochs:
                self._epoch(epoch, is_first=turn == 0)
        self.busy = (time.process_time() - clocks[1]) / (time.perf_counter() - clocks[0])

    def _epoch(self, epoch, is_first):
        drive, times, point_map = self.drive, self.times, self.drive.point_map
        prior, ahead = drive.prior(epoch), drive.scan(epoch)
        for method in self.methods.values():
            method.prepare(ahead, point_map, prior)  # its part of the map; kept until it is timed below
        estimates = {}
        scan = times("read", drive.scan, epoch)
        times("normals", getattr, scan, "normals")
        times("thin", scan.thinned, MaximumConsensus().thinning)
        for name, search in SEARCHES.items():
            found = times(f"search, {name}", search, scan, point_map, prior, SPACE)
            if isinstance(found, Estimate):
                estimates[name] = found
            else:
                self.concluded.add(name)
                conclude = MaximumConsensus(SPACE).conclude
                estimates[name] = times(f"conclude, {name}", conclude, found, scan, point_map)
        for name, method in self.methods.items():
            ready = times(f"{name}: scan", method.prepare, scan, point_map, prior)
            estimates[name] = times(f"{name}: align", ready.align, prior)
        for name, estimate in estimates.items():
            if is_first and estimate is not None:
                self.n_right[name] += pose_error(estimate.pose, drive.reference(epoch)).is_success

    @cached_property
    def rows(self):
        """Of the table: what is timed, its stages, and whose answer it ends with."""
        rows = [(stage, [stage], None) for stage in ("read", "normals", "thin")]
        for name in SEARCHES:
            stages = [
                "read",
                "normals",
                *([] if name in WITHOUT_THINNING else ["thin"]),
                f"search, {name}",
            ]
            stages += [f"conclude, {name}"] if name in self.concluded else []
            rows += [(stage, [stage], None) for stage in stages if stage.endswith(name)]
            rows.append((f"end to end, {name}", stages, name))
        for name in self.methods:
            stages = [f"{name}: scan", f"{name}: align"]
            rows += [(stage, [stage], None) for stage in stages]
            rows.append((f"end to end, {name}", ["read", *stages], name))
        return rows

    def percentiles(self, stages):
        """Of the epochs' times of some stages together, ms."""
        return np.percentile(self.times.of(*stages), PERCENTILES)

    def table(self):
        """Lines of Markdown."""
        search = self.percentiles([f"search, {FIRST}"])[0]
        lines = [f"### {self.drive.name}", "", *self._sizes(), ""]
        lines += [
            "| | p50 ms | p95 ms | p99 ms | p50 over the search's | wall p50 ms | wall p99 ms | right |",
            "|---" * 8 + "|",
        ]
        for label, stages, name in self.rows:
            numbers = self.percentiles(stages)
            wall = np.percentile(self.times.of(*stages, clock=WALL), (50, 99))
            words = f"{_joined(numbers)} | {numbers[0] / search:.2f} | {_joined(wall)}"
            right = f"{self.n_right[name]} of {len(self.drive.epochs)}" if name in self.n_right else ""
            lines.append(f"| {f'**{label}**' if name else label} | {words} | {right} |")
        return [*lines, ""]

    def _sizes(self):
        """What an epoch of the drive is like."""
        drive, point_map, sizes = self.drive, self.drive.point_map, []
        for epoch in drive.epochs:
            scan, prior = drive.scan(epoch), drive.prior(epoch)
            reach = np.linalg.norm(scan.points[:, :2], axis=1).max(initial=0.0) + SPACE.reach
            n_voxels = sum(len(tile.voxels) for tile in point_map.tiles_within(prior.x, prior.y, reach))
            searched = scan.thinned(MaximumConsensus().thinning)
            n_matches = exhaustive(searched, point_map, prior, SPACE).moments[..., 0].sum()
            thinned = [len(thin(scan.points, THINNING)), len(searched)]
            off = pose_error(prior, drive.reference(epoch)).distance
            sizes.append((len(scan), n_voxels, n_matches, *thinned, off))
        points, voxels, matches, thinned, finer, off = np.median(sizes, axis=0)
        slowest = self.times.largest(*next(stages for _, stages, name in self.rows if name == FIRST))
        return [
            f"{len(drive.epochs)} epochs, prior `{drive.prior_name}` ({off:.2f} m off in the median). Medians:"
            f" {points:,.0f} points, {voxels / 1e6:.2f} million voxels around, {matches / 1e6:.1f} million matches in"
            f" {SPACE.n_cells:,} cells; the scan thinned to {THINNING} m has {thinned:,.0f} points, to 0.25 m"
            f" {finer:,.0f}. Slowest single run of the {FIRST} search, end to end: {slowest:.0f} ms. Processor time"
            f" over wall time: {self.busy:.2f}."
        ]


def _joined(numbers):
    return " | ".join(f"{number:.1f}" for number in numbers)


def scaling(drive):
    """Lines of Markdown: the searches over the size of the search space, the scan and the map."""
    widths = 1.02, 2.04, 3.0, 6.0  # multiples of the cell
    cases = {f"half width {width:g} m": (SearchSpace(half_width=width), 1, "standard") for width in widths}
    cases |= {f"every {every} point": (SPACE, int(every[0]), "standard") for every in ("2nd", "4th")}
    cases |= {words: (SPACE, 1, name) for name, words in DENSITIES.items() if name in drive.bench.maps}
    scaled = [name for name in SEARCHES if name not in WITHOUT_THINNING]
    times, n_points = Times(), defaultdict(list)
    for _ in range(N_ROUNDS + 1):
        for epoch in drive.epochs:
            whole = drive.scan(epoch)
            for case, (space, every, map_name) in cases.items():
                scan = Scan(whole.points[::every], whole.normals[::every])
                n_points[case].append(len(scan.thinned(MaximumConsensus().thinning)))
                there = drive.bench.maps[map_name], drive.prior(epoch, map_name)
                for name in scaled:
                    times((case, name), SEARCHES[name], scan, *there, space)
    lines = [
        f"### Scaling: {drive.name}",
        "",
        "The search alone; the case of the table above is *half width 3 m*.",
        "",
    ]
    lines += [
        "| search | case | cells | points | p50 ms | p95 ms | p99 ms | p50 over 3 m's |",
        "|---" * 8 + "|",
    ]
    for name in scaled:
        middle = np.median(times.of(("half width 3 m", name)))
        for case, (space, _, _) in cases.items():
            numbers = np.percentile(times.of((case, name)), PERCENTILES)
            lines.append(
                f"| {name} | {case} | {space.n_cells:,} | {np.median(n_points[case]):,.0f} |"
                f" {_joined(numbers)} | {numbers[0] / middle:.2f} |"
            )
    return [*lines, ""]


# Inches: the picture is read on phones, so it is narrow and its letters are large.
def panel_rows(measured):
    """Label, percentiles and style of each row: 0 for stages, 1 for searches and 2 for registrations."""
    found = []
    for label, stages, name in measured.rows:
        if name or ":" not in label:
            style = 0 if name is None else 1 if name in SEARCHES else 2
            words = label if name in SEARCHES else label.removeprefix("end to end, ")
            words = words.removesuffix(f", {FIRST}") if len(SEARCHES) == 1 else words
            found.append((words, measured.percentiles(stages), style))
    return sorted(found, key=lambda row: row[2])


def put_into(page, lines):
    """Replace what stands between the marks of a page."""
    text = page.read_text() if page.exists() else f"{BEGIN}\n{END}\n"
    before, rest = text.split(BEGIN)
    page.write_text("\n".join([before + BEGIN, "", *lines, END]) + rest.split(END)[1])


def _printed(lines):
    print("\n".join(lines), flush=True)
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("studies", nargs="+", metavar="STUDY")
    parser.add_argument("--epochs", type=int, default=40)
    parser.add_argument("--out", type=Path, default=DOCS / "images" / "latency.svg")
    parser.add_argument("--page", type=Path, default=DOCS / "latency.md")
    arguments = parser.parse_args()
    header("One epoch, end to end and by stage, on one core")
    drives = [Drive.of_study(folder, arguments.epochs) for folder in arguments.studies]
    all_measured, lines = [], []
    for drive in drives:
        all_measured.append(Measured(drive))
        lines += _printed(all_measured[-1].table())
    lines += _printed(scaling(drives[0]))
    put_into(arguments.page, lines)
    plot(arguments.out, {measured.drive.name: panel_rows(measured) for measured in all_measured})


if __name__ == "__main__":
    main()
