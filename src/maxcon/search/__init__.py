"""Searches: the definition (`reference`) and the fast ones that equal it."""

from maxcon.search import reference
from maxcon.search.accumulator import Multiplicity, SearchMethod, Weighting, level_of
from maxcon.search.branch_and_bound import branch_and_bound
from maxcon.search.exhaustive import accumulators, exhaustive, highest_of
from maxcon.search.reference import consensus_set
from maxcon.search.scored_cells import Found

__all__ = [
    "Found", "Multiplicity", "SearchMethod", "Weighting", "accumulators", "branch_and_bound", "consensus_set",
    "exhaustive", "highest_of", "level_of", "reference",
]  # fmt: skip
