# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The demo: a small city is simulated, mapped, driven, localized and reported."""

from maxcon.lab.demo.report import report_demo
from maxcon.lab.demo.run import (
    DEMO_METHODS,
    DEMO_NAMES,
    DemoDrive,
    DemoMethod,
    MethodResult,
    check_extras,
    localize_demo,
    prepare_demo,
)
from maxcon.lab.demo.wide import WideResult, try_wide_priors

__all__ = [
    "DEMO_METHODS",
    "DEMO_NAMES",
    "DemoDrive",
    "DemoMethod",
    "MethodResult",
    "WideResult",
    "check_extras",
    "localize_demo",
    "prepare_demo",
    "report_demo",
    "try_wide_priors",
]
