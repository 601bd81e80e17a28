# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map of many square kilometres: blocks of smaller ones beside each other, written as a build writes.

    python benchmarks/large_map.py write LARGE.map MAP... [--blocks 7]
    python benchmarks/large_map.py read LARGE.map|s3://... MAP [--scans FOLDER --prior FILE] [--places 12]

`write` puts blocks x blocks of the maps in turn side by side, each moved by whole tiles, through `MapWriter`. `read`
opens the result and localizes epochs of a drive of one MAP at as many places, in blocks far from each other,
and prints how long opening, first and later epochs took (median and longest of the first; and the processor's time of
these, where others use the machine), and the most memory of the process.
"""

import argparse
import json
import resource
import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from maxcon import MaximumConsensus, PointMap, Scan, SearchSpace, open_scans, read_trajectory
from maxcon.map import TILE_VOXELS
from maxcon.map.manifest import GROUND, TILES, read_manifest
from maxcon.map.storage import open_storage
from maxcon.map.store import MapWriter, Section

# Tiles of 6 cm that a block of the campaign takes along x and y.
BLOCK = (15, 16)


def write(out, maps, n_blocks):
    start = time.perf_counter()
    places = [open_storage(path) for path in maps]
    manifests = [read_manifest(place) for place in places]
    first = manifests[0]
    edge = TILE_VOXELS * first.cell
    Path(out).mkdir()
    with MapWriter(Path(out)) as writer:
        for name in (TILES, GROUND):
            sections = [Section(place, manifest, name) for place, manifest in zip(places, manifests, strict=True)]
            for x, y in product(range(n_blocks), repeat=2):
                section = sections[(x * n_blocks + y) % len(sections)]
                low = np.array(sorted(section.keys)).min(axis=0)
                for record in section.records():
                    moved = (record.key[0] - int(low[0]) + BLOCK[0] * x, record.key[1] - int(low[1]) + BLOCK[1] * y)
                    if moved[0] < BLOCK[0] * (x + 1) and moved[1] < BLOCK[1] * (y + 1):
                        writer.put(replace(record, key=moved))
        build = {"program": "benchmarks/large_map.py"}
        written = writer.finish(replace(first, origin=(0.0, 0.0, 0.0), build=build))
    seconds = time.perf_counter() - start
    area = n_blocks**2 * BLOCK[0] * BLOCK[1] * edge**2 / 1e6
    n_bytes = sum(file.n_bytes for table in written.sections.values() for file in table.files)
    n_files = sum(len(table.files) for table in written.sections.values())
    print(json.dumps({
        "km2": round(area, 2), "tiles": len(written.tiles), "voxels": written.n_voxels, "gigabytes": n_bytes / 1e9,
        "files": n_files, "seconds": round(seconds, 1),
    }))  # fmt: skip


def read(place, small_path, scans_folder, prior_file, times, n_places, n_blocks, n_maps):
    small = read_manifest(open_storage(small_path))
    low = small.tiles.rows["key"].min(axis=0)
    start = time.perf_counter()
    large = PointMap.open(place, cache_bytes=2**28)
    opened = time.perf_counter() - start
    scans, reference = open_scans(scans_folder, times), read_trajectory(prior_file)
    method = MaximumConsensus(SearchSpace(1.5, 0.06, 3.0, 1.0))
    edge = TILE_VOXELS * small.cell
    blocks = [(x, y) for x, y in product(range(n_blocks), repeat=2) if (x * n_blocks + y) % n_maps == 0]
    chosen = [blocks[i] for i in np.linspace(0, len(blocks) - 1, n_places).round().astype(int)]
    epochs = np.linspace(0, len(scans.times) - 1, n_places).round().astype(int)
    rows = []
    warm = False
    for block, epoch in zip(chosen, epochs.tolist(), strict=True):
        raw = scans.read(epoch, 1.0, 120.0)
        truth = reference.at(raw.time, 0.5)
        local = PointMap.open(small_path).frame.pose_to_local(truth)
        shift = (np.array(block) * BLOCK - low) * edge
        prior = replace(local, x=local.x + shift[0] + 0.4, y=local.y + shift[1] - 0.3)
        scan = Scan(raw.points, time=raw.time)
        if not warm:  # kernels are compiled or loaded by an epoch that is not timed, in its own block
            method.localize(scan, PointMap.open(small_path), local)
            warm = True
        took, computed = [], []
        for _ in range(2):
            start, start_cpu = time.perf_counter(), time.process_time()
            estimate = method.localize(scan, large, prior)
            took.append(time.perf_counter() - start)
            computed.append(time.process_time() - start_cpu)
        error = float(np.hypot(estimate.pose.x - local.x - shift[0], estimate.pose.y - local.y - shift[1]))
        rows.append((*took, error, estimate.is_localized, computed[0]))
        print(block, epoch, *(f"{value:.3f}" for value in rows[-1][:3]), estimate.status.value, flush=True)
    firsts, seconds, errors, localized, computed = zip(*rows, strict=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    said = {
        "open_s": opened,
        "first_s": float(np.median(firsts)),
        "longest_first_s": max(firsts),
        "first_cpu_s": float(np.median(computed)),
        "second_s": float(np.median(seconds)),
        "largest_error_m": max(errors),
    }
    counts = {"localized": sum(localized), "of": len(rows), "most_memory_mib": round(peak)}
    print(json.dumps({name: round(value, 3) for name, value in said.items()} | counts))


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write")
    writing.add_argument("out")
    writing.add_argument("maps", nargs="+")
    writing.add_argument("--blocks", type=int, default=7)
    reading = commands.add_parser("read")
    reading.add_argument("map")
    reading.add_argument("small")
    reading.add_argument("--scans", required=True)
    reading.add_argument("--times")
    reading.add_argument("--prior", required=True)
    reading.add_argument("--places", type=int, default=12)
    reading.add_argument("--blocks", type=int, default=7)
    reading.add_argument("--maps", type=int, default=5)
    options = parser.parse_args()
    if options.command == "write":
        write(options.out, options.maps, options.blocks)
    else:
        read(
            options.map, options.small, options.scans, options.prior, options.times, options.places,
            options.blocks, options.maps,
        )  # fmt: skip


if __name__ == "__main__":
    main()
