# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long does `maxcon --help` take, as a whole process?

python benchmarks/start_up.py
"""

import subprocess
import sys

import numpy as np
from header import header, times_ms

HELP = [sys.executable, "-c", "import sys; sys.argv = ['maxcon', '--help']; from maxcon.cli import main; main()"]
NOTHING = [sys.executable, "-c", "pass"]


def main() -> None:
    header("Start-up")
    taken = {
        name: times_ms(lambda command=command: subprocess.run(command, capture_output=True, check=True), 11)
        for name, command in (("maxcon --help", HELP), ("python alone", NOTHING))
    }
    print("| process | ms, median of 11 | least | most |")
    print("|---|---|---|---|")
    for name, values in taken.items():
        print(f"| {name} | {np.median(values):.0f} | {values.min():.0f} | {values.max():.0f} |")


if __name__ == "__main__":
    main()
