# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Inputs that reach new lines are kept and mutated on: `python tests/fuzz/guided.py nmea --seconds 600`. Linux.

Begins with one seed, named by its label (`--list`), and lets atheris follow which branches of the package's readers
an input takes. Fine is what is fine in `python tests/fuzz`. Findings are written into --out, and the run goes on; what
ends the process, takes over 10 s or over 2 GiB ends the run, and libFuzzer says so.
"""

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=["maxcon.io", "maxcon.scan.mounting", "maxcon.lab.dataset", "maxcon.map.manifest"]
):
    from fuzz_seeds import Seed, make_seeds
    from fuzz_worker import outcome

SECONDS_OF_AN_INPUT, MEGABYTES = 10, 2048


def main() -> None:
    """Fuzz one kind of file until the time is over."""
    arguments = _arguments()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seeds = {seed.label: seed for seed in make_seeds(folder)}
        if arguments.list or arguments.label not in seeds:
            raise SystemExit(f"One of: {', '.join(sorted(seeds))}")
        seed = seeds[arguments.label]
        corpus = arguments.corpus or folder / "corpus"
        corpus.mkdir(exist_ok=True, parents=True)
        (corpus / "seed").write_bytes(seed.data)
        options = [
            f"-max_total_time={arguments.seconds}",
            f"-timeout={SECONDS_OF_AN_INPUT}",
            f"-rss_limit_mb={MEGABYTES}",
            f"-seed={arguments.seed}",
            f"-max_len={max(4096, 2 * len(seed.data))}",
            f"-artifact_prefix={arguments.out}/",
        ]
        arguments.out.mkdir(exist_ok=True, parents=True)
        atheris.Setup([sys.argv[0], *options, str(corpus)], _one_input(seed, folder, arguments.out))
        atheris.Fuzz()


def _one_input(seed: Seed, folder: Path, out: Path):
    seen = set()

    def read(data: bytes) -> None:
        said = outcome(seed, data, folder)
        if said not in ("read", "refused") and said not in seen:
            seen.add(said)
            print(f"found: {said}", file=sys.stderr, flush=True)
            (out / f"found_{len(seen)}_{Path(seed.name).name or 'message'}").write_bytes(data)

    return read


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("label", nargs="?", help="of the seed to begin with")
    parser.add_argument("--list", action="store_true", help="labels of all seeds")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1, help="of the mutations")
    parser.add_argument("--corpus", type=Path, help="folder of inputs that reached new branches, to go on with")
    parser.add_argument("--out", type=Path, default=Path("fuzz-findings"), help="folder for findings")
    return parser.parse_args()


if __name__ == "__main__":
    main()
