# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`python -m maxcon`."""

from maxcon.cli import main

if __name__ == "__main__":
    main()
