# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The drives that benchmarks take: a dataset.toml, or a folder with one, named if wanted ("city=city/dataset.toml").

Maps of clouds are built once, in the folder of a benchmark's results: two benchmarks with one folder share them.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from maxcon import PointMap, Scan, open_scans, read_trajectory
from maxcon.lab.dataset import DESCRIPTION, Dataset
from maxcon.lab.study import Study
from maxcon.lab.study.bench import REFERENCE, Bench
from maxcon.lab.study.methods import STANDARD, make_maps
from maxcon.lab.study.prior_trials import prior_at

DOCS = Path(__file__).parents[1] / "docs"
GROUND = "ground"
# All tiles of a drive stay in memory, with what searches derive from them.
CACHE_BYTES = 2**33


@dataclass(frozen=True)
class NamedDataset:
    """A dataset and what its drive is called."""

    name: str
    dataset: Dataset

    @classmethod
    def of_word(cls, word):
        """From what the user typed."""
        name, _, path = word.rpartition("=")
        dataset = Dataset.open(path)
        file = dataset.path
        return cls(name or (file.parent.resolve().name if file.name == DESCRIPTION else file.stem), dataset)

    @property
    def peers_map(self):
        """Name of the map that registrations get: with ground, which holds height and tilt; of a built map, that."""
        return GROUND if self.dataset.map_path is None else STANDARD

    def maps(self, folder, names):
        """Path of each map, those that are missing built in a folder."""
        return make_maps(self.dataset, folder / f"{self.name} maps", sorted(names))

    def bench(self, folder, names):
        """Scans, reference and maps."""
        return Bench.open(self.dataset, self.maps(folder, names))

    def bench_in_memory(self, folder, names):
        """The same, with maps that keep all tiles they have read."""
        kept = {name: PointMap.open(path, cache_bytes=CACHE_BYTES) for name, path in self.maps(folder, names).items()}
        return replace(self.bench(folder, names), maps=kept)


def points_of(bench, epoch):
    """Points of an epoch within range."""
    return bench.scans.read(epoch, bench.options.min_range, bench.options.max_range).points


def prior_and_reference(bench, map_name, epoch, level, seed):
    """The prior of an epoch, wrong by up to a level, and the pose held for true, in the frame of a map."""
    true_pose = bench.priors[REFERENCE].at(float(bench.scans.times[epoch]))
    reference = bench.maps[map_name].frame.pose_to_local(true_pose)
    return prior_at(reference, level, seed, epoch), reference


def bench_of_study(folder):
    """A study, and the scans, poses and standard map that it was made with."""
    study = Study.open(folder)
    dataset = Dataset.open(study.configuration.dataset)
    return study, Bench.open(dataset, {STANDARD: dataset.map_path or study.folder / "maps" / f"{STANDARD}.map"})


def add_known_drive(parser, every):
    """Arguments of a drive whose poses are known: MAP SCANS --reference REFERENCE [--every N]."""
    parser.add_argument("map")
    parser.add_argument("scans")
    parser.add_argument("--reference", required=True)
    parser.add_argument("--every", type=int, default=every, metavar="N", help="take each N-th scan")


def known_drive(options):
    """The map of such a drive, and its scans, each with the pose held for true, local frame."""
    point_map, scans = PointMap.open(options.map), open_scans(options.scans)
    reference = read_trajectory(options.reference)
    raws = (scans.read(epoch, 1.0, 120.0) for epoch in range(0, len(scans), options.every))
    return point_map, [(Scan(raw.points), point_map.frame.pose_to_local(reference.at(raw.time))) for raw in raws]
