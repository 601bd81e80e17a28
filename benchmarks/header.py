# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What benchmarks print above their tables, and how they take times."""

import platform
import time
from pathlib import Path

import numpy as np

import maxcon


def times_ms(call, n=15):
    """Times of a call, ms, after one to warm up."""
    call()
    taken = []
    for _ in range(n):
        start = time.perf_counter()
        call()
        taken.append(1e3 * (time.perf_counter() - start))
    return np.array(taken)


def header(title: str) -> None:
    """Say what was measured, and where."""
    print(f"# {title}\n\nmaxcon {maxcon.__version__}, Python {platform.python_version()}, {_processor()}\n")


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({len(names)} processors)" if names else platform.processor()
