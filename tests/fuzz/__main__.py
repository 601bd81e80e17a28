"""Read mutated files of every kind: `python tests/fuzz --inputs 200000 --seed 0`. Linux.

Fine is what reads, or what is refused with an error of the package. Everything else is a finding: another exception,
a process that ends, more than 10 s, more than 1 GiB of memory. Findings are written with the number that makes them
again: `python tests/fuzz --seed 0 --only NUMBER`.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

from fuzz_seeds import Seed, make_seeds
from fuzz_watch import input_of, watched, work_off


def main() -> int:
    """Fuzz, and return 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=1000, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="the same seed makes the same inputs")
    parser.add_argument("--others", type=Path, help="folder of more good files, up to 150 kB each")
    parser.add_argument("--only", type=int, help="write this input into a file, and read nothing")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        seeds = make_seeds(Path(name), arguments.others)
        if arguments.only is None:
            return _fuzz(arguments.inputs, arguments.seed, seeds, Path(name))
        chosen, data = input_of(seeds, arguments.seed, arguments.only)
        file = Path(f"input_{arguments.only}_{Path(chosen.name).name or 'message'}")
        file.write_bytes(data)
        print(f"{file}: {chosen.label}, for the reader {chosen.reader}")
        return 0


def _fuzz(n_inputs: int, seed: int, seeds: list[Seed], folder: Path) -> int:
    """Start a process that reads, and another one wherever it ended early or took too long."""
    counts: Counter[tuple[str, str]] = Counter()
    slowest, at, began = (0.0, ""), 0, time.perf_counter()
    while at < n_inputs:
        for said in watched(work_off, seeds, seed, range(at, n_inputs), folder):
            at = said.number + 1
            counts[said.reader, said.words if said.is_fine else "found"] += 1
            slowest = max(slowest, (said.seconds, f"{said.number} ({said.label})"))
            if not said.is_fine:
                print(said, flush=True)
    print(f"{'reader':<12} {'read':>8} {'refused':>8} {'found':>6}")
    for reader in sorted({reader for reader, _ in counts}):
        row = [counts[reader, words] for words in ("read", "refused", "found")]
        print(f"{reader:<12} {row[0]:>8,} {row[1]:>8,} {row[2]:>6,}")
    total = time.perf_counter() - began
    print(f"{n_inputs:,} inputs in {total:.0f} s; slowest {slowest[0]:.2f} s: {slowest[1]}")
    return 1 if any(words == "found" for _, words in counts) else 0


if __name__ == "__main__":
    sys.exit(main())
