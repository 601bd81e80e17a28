# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Whether rows are the same wherever they are made and whoever is killed meanwhile, and what workers gain.

Rows of a study, or of a table of drives:

python benchmarks/engine.py DATASET FOLDER [--methods maxcon] [--epochs N] [--kills 20] [--every 15]
    [--ways one,two,tcp,killed,tcp-killed]
python benchmarks/engine.py DRIVES.csv FOLDER --map MAP ...

`one`: in one process; `two`: with two workers; `tcp`: with two workers started by hand, each with tiles of its own;
`killed`, `tcp-killed`: likewise, and a worker, chosen by chance, gets SIGKILL so many times. What is in FOLDER
already is not made again.
"""

import argparse
import os
import random
import resource
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pyarrow

from maxcon.drive.poses_table import PosesDataset
from maxcon.lab.study import Study

MAXCON = [sys.executable, "-c", "from maxcon.cli import main; main()"]
DASK = [sys.executable, "-m", "dask"]
ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def worker_processes(pids):
    """Children of processes that are dask workers: no helpers of multiprocessing."""
    for pid in pids:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        for path in Path(f"/proc/{pid}/task").glob("*/children"):
            children += path.read_text().split()
        for child in sorted(set(children)):
            words = Path(f"/proc/{child}/cmdline").read_bytes()
            if b"spawn_main" in words and b"resource_tracker" not in words:
                yield int(child)


@contextmanager
def by_hand():
    """A scheduler and two workers on the loopback interface; yield its address and the workers' nannies."""
    with ExitStack() as stack:

        def start(*words):
            process = subprocess.Popen([*DASK, *words], stderr=subprocess.PIPE, text=True, env=os.environ | ALONE)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            return process

        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0")
        address = next(word for line in scheduler.stderr for word in line.split() if word.startswith("tcp://"))
        options = ("--host", "127.0.0.1", "--nthreads", "1", "--nworkers", "1", "--memory-limit", "0")
        yield address, [start("worker", address, *options).pid for _ in range(2)]


def command_of(arguments, out):
    """What makes the rows: a study, or a drive of a table of drives."""
    if arguments.map is not None:
        return ["localize", arguments.map, "--drives", arguments.dataset, "-o", out, "--quiet"]
    command = ["study", arguments.dataset, "-o", out, "--methods", arguments.methods, "--quiet"]
    return command + (["--epochs", arguments.epochs] if arguments.epochs else [])


def rows_of(arguments, out):
    """All rows that were made, without how long each took."""
    if arguments.map is None:
        return Study.open(out).table.drop_columns(["ms"])
    names = sorted(path.name.partition("=")[2] for path in out.glob("drive=*"))
    return pyarrow.concat_tables(PosesDataset(out).rows(name) for name in names).drop_columns(["ms"])


def rows(arguments, way, *options, nannies=()):
    """Make the rows, killing workers if the way says so; return them."""
    out = arguments.folder / way
    if (out / "table.parquet").exists() or list(out.glob("drive=*")):
        print(f"{way}: there already", flush=True)
        return rows_of(arguments, out)
    before, started, kills = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic(), 0
    command = [*MAXCON, *map(str, [*command_of(arguments, out), *options])]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    chance = random.Random(7)
    due = time.monotonic() + arguments.every
    while process.poll() is None:
        time.sleep(0.2)
        has_begun = any(path.name[0] != "." for path in out.rglob("*.parquet"))
        if "killed" in way and kills < arguments.kills and has_begun and time.monotonic() > due:
            victims = list(worker_processes(nannies or [process.pid]))
            if victims:
                os.kill(chance.choice(victims), signal.SIGKILL)
                kills += 1
                due = time.monotonic() + chance.uniform(0.5, 1.5) * arguments.every
    assert process.returncode in (0, 1), process.returncode
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    wall = time.monotonic() - started
    print(f"{way}: {wall:.0f} s, processors {spent:.0f} s, {kills} workers killed", flush=True)
    return rows_of(arguments, out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--map", type=Path, help="DATASET is a table of drives in this map")
    parser.add_argument("--methods", default="maxcon")
    parser.add_argument("--epochs", type=int)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--every", type=float, default=15.0, help="s between two kills, in the mean")
    parser.add_argument("--ways", default="one,two,tcp,killed,tcp-killed")
    arguments = parser.parse_args()
    tables = {}
    for way in arguments.ways.split(","):
        if way.startswith("tcp"):
            with by_hand() as (address, nannies):
                tables[way] = rows(arguments, way, "--scheduler", address, nannies=nannies)
        else:
            tables[way] = rows(arguments, way, "--workers", "1" if way == "one" else "2")
    first, *others = tables
    for way in others:
        words = "the same" if tables[way].equals(tables[first]) else "OTHERS"
        print(f"rows of {way}, {len(tables[way])}, against {first}, all columns but ms: {words}")


if __name__ == "__main__":
    main()
