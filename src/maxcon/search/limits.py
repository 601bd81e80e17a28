# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Limits: parameters of branch and bound for time and memory; none of them changes which cell is the best."""

from dataclasses import dataclass

__all__ = ["DEFAULT_LIMITS", "Limits"]


@dataclass(frozen=True, slots=True)
class Limits:
    """When branch and bound scores, bounds again, or looks at all cells of a window (decision 14).

    The best cell, and every other that reaches the share that is asked for, are the same for any values. Time and
    memory are not, nor is `Found.rest` where no other cell reaches the share: it is the highest bound of those ruled
    out then.

    Parameters
    ----------
    first_cells : int
        Cells scored before any is ruled out, those with the highest bounds: the better the best score is early, the
        less is left.
    scored_at_once : int
        Candidates scored at a time, from the highest bound on.
    left_out : float
        Voxels are left out of the sums that bound cells if all of them together add less than this share of the score
        that cells must reach.
    left_out_of_scan : float
        The same before any cell is scored: the share of what all scan points together could add along the axis that
        they determine least.
    most_candidates : int
        So many candidates are scored one by one. If one bound leaves more, some are scored at once, the others bounded
        again, and what is left after that is perhaps searched as a window.
    most_kept : int
        Of a space in several parts, one with more candidates than this is bounded again after the others: they may
        hold a better cell.
    undecided : int
        If the first bound leaves more than one in `undecided` cells, no second one is made: it would rule out little.
    cells_per_candidate : int
        How many cells an exhaustive search of a window scores in the time that one candidate by itself takes.
    margin : int
        Rows and columns by which a window is taken to be larger when its time is guessed: an exhaustive search also
        looks at voxels that only cells beside the window meet.
    bound_steps : int
        Steps in which the least sum is sought with which a cell can reach the asked score.
    headings_per_pass, cells_per_pass : int
        Cells bounded in one pass: 2^22 sums take 16 MiB, or 32 MiB where voxels count as often as they have points.
        One row is never parted, even if it has more.
    scored_per_pass : int
        Cells scored in one pass of an exhaustive window search: 2^20 take 32 MiB.
    most_scored : int
        A search that would score more cells in windows is refused: nothing stands out in it.
    """

    first_cells: int = 2
    scored_at_once: int = 8
    left_out: float = 0.1
    left_out_of_scan: float = 0.01
    most_candidates: int = 192
    most_kept: int = 2**14
    undecided: int = 20
    cells_per_candidate: int = 120
    margin: int = 24
    bound_steps: int = 4096
    headings_per_pass: int = 16
    cells_per_pass: int = 2**22
    scored_per_pass: int = 2**20
    most_scored: int = 2**26


DEFAULT_LIMITS = Limits()
