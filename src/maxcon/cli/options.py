# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options that several commands have."""

from typing import Annotated

import typer

__all__ = ["HeadingStepDeg", "MaxRange", "MinRange"]

HeadingStepDeg = Annotated[float, typer.Option(metavar="DEG", help="Step between headings, degrees.")]
MinRange = Annotated[float, typer.Option(metavar="M", help="Nearer points are left out.")]
MaxRange = Annotated[float, typer.Option(metavar="M", help="Farther points are left out.")]
