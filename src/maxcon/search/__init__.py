# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Searches: the definition and the fast paths that equal it."""

from maxcon.search import reference
from maxcon.search.branch_and_bound import branch_and_bound
from maxcon.search.consensus import consensus_set
from maxcon.search.exhaustive import exhaustive
from maxcon.search.found import Found, Standing
from maxcon.search.heights import accumulators, highest_of
from maxcon.search.limits import Limits
from maxcon.search.matching import level_of
from maxcon.search.options import Multiplicity, SearchMethod, Weighting

__all__ = [
    "Found",
    "Limits",
    "Multiplicity",
    "SearchMethod",
    "Standing",
    "Weighting",
    "accumulators",
    "branch_and_bound",
    "consensus_set",
    "exhaustive",
    "highest_of",
    "level_of",
    "reference",
]
