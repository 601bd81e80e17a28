# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where `maxcon localize` searches: within fixed half widths, or standard deviations of the prior."""

import math
from typing import TYPE_CHECKING

from maxcon.cli.flags import OptionGroup, flag
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.drive.localize import EpochEstimate
    from maxcon.drive.within_sigmas import WithinSigmas
    from maxcon.localizer import MaximumConsensus
    from maxcon.scan.trajectory import Trajectory
    from maxcon.search.space import SearchSpace

SIGMAS, LARGEST_HALF_WIDTH = 3.0, 24.0


class SpaceOptions(OptionGroup, title="Search space"):
    """Where a scan is searched for around its prior; None for what is not given."""

    wider: float = flag(12.0, "Search so far around an answer that is in doubt, m; 0: never.", metavar="M")
    half_width: float | None = flag(
        None,
        "Largest offset from the prior in x and y, m. If not given: of the prior's covariances, or 12.",
        metavar="M",
    )
    heading_half_width_deg: float | None = flag(
        None, "Largest turn from the prior's heading, degrees; likewise, or 10.", metavar="DEG"
    )
    height_half_width: float | None = flag(
        None,
        "Largest offset from the prior in z, m, searched where the ground does not tell the height; a multiple of"
        " the cell. 0 if not given: the height is the prior's there.",
        metavar="M",
    )
    sigma_position: float | None = flag(
        None, "Instead of half widths: standard deviation of every prior's x, and of its y, m.", metavar="M"
    )
    sigma_heading_deg: float | None = flag(None, "Standard deviation of its heading, degrees.", metavar="DEG")
    sigmas: float | None = flag(
        None, "How many standard deviations to search, these or the prior's own; 3 if not given.", metavar="K"
    )
    largest_half_width: float | None = flag(
        None,
        "No search within standard deviations is wider than this, nor one that is repeated, twice as wide each time,"
        " where the answer is in doubt, m; 24 if not given.",
        metavar="M",
    )
    cell: float | None = flag(
        None,
        "Search in cells of this edge alone, m: the map's, or 2, 4, ... 32 times it. If neither this nor a heading"
        " step is given, coarse to fine.",
        metavar="M",
    )
    heading_step_deg: float | None = flag(
        None, "Step between headings, degrees; 0.5 beside --cell, if not given.", metavar="DEG"
    )

    def fixed(self) -> "SearchSpace":
        """Return the space of the half widths, the usual ones if not given, rounded up to whole steps."""
        from maxcon.search.space import PAPER_STEP_DEG, SearchSpace

        usual = SearchSpace()
        step_deg = self.heading_step_deg
        if step_deg is None and self.cell is not None:
            step_deg = PAPER_STEP_DEG
        return SearchSpace(
            _in_steps(self.half_width, usual.half_width, self.cell),
            self.cell,
            _in_steps(self.heading_half_width_deg, usual.heading_half_width_deg, step_deg),
            self.heading_step_deg,
            _in_steps(self.height_half_width, 0.0, self.cell),
        )

    def within_sigmas(
        self, method: "MaximumConsensus", prior: "Trajectory", max_gap: float, *, track: bool
    ) -> "WithinSigmas | None":
        """Return what searches within given standard deviations, or those of the prior; None for half widths.

        A track is searched within half widths, unless standard deviations are given. OptionError if both kinds are
        given, or one standard deviation without the other.
        """
        from maxcon.drive.within_sigmas import WithinSigmas

        covariance = self._given_covariance()
        is_fixed = self.half_width is not None or self.heading_half_width_deg is not None
        if covariance is None and (is_fixed or track or prior.covariances is None):
            self._check_alone()
            return None
        return WithinSigmas(
            method,
            prior if covariance is None else _with_covariance(prior, covariance),
            SIGMAS if self.sigmas is None else self.sigmas,
            LARGEST_HALF_WIDTH if self.largest_half_width is None else self.largest_half_width,
            max_gap,
        )

    def _given_covariance(self) -> list[list[float]] | None:
        """The covariance of x, y and heading that is given for all priors, if it is."""
        if self.half_width is not None or self.heading_half_width_deg is not None:
            given = (self.sigma_position, self.sigma_heading_deg, self.sigmas, self.largest_half_width)
            if any(value is not None for value in given):
                fixed = "--half-width" if self.half_width is not None else "--heading-half-width-deg"
                raise OptionError(
                    f"Expected either half widths or standard deviations of the prior, got {fixed} beside them."
                    " Leave one kind out."
                )
        if self.sigmas is not None and not 0.0 < self.sigmas < math.inf:
            raise OptionError(f"Expected --sigmas > 0, got {self.sigmas}. Left out it is 3.")
        if self.sigma_position is None and self.sigma_heading_deg is None:
            return None
        if self.sigma_position is None or self.sigma_heading_deg is None:
            missing = "--sigma-position" if self.sigma_position is None else "--sigma-heading-deg"
            raise OptionError(
                f"Expected --sigma-position and --sigma-heading-deg together, got no {missing}."
                " Give it, 0 if it is exact."
            )
        variance = _variance("--sigma-position", self.sigma_position, 1.0)
        heading_variance = _variance("--sigma-heading-deg", self.sigma_heading_deg, math.radians(1.0))
        return [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, heading_variance]]

    def _check_alone(self) -> None:
        """Refuse what says something of standard deviations where there are none."""
        for name, value in (("--sigmas", self.sigmas), ("--largest-half-width", self.largest_half_width)):
            if value is not None:
                raise OptionError(
                    f"Expected --sigma-position and --sigma-heading-deg together with {name}, or a CSV prior with"
                    " covariances and no --track, got no --sigma-position. Give both, or leave it out."
                )

    def words(self, windows: "WithinSigmas | None", prior: "Trajectory", epochs: "list[EpochEstimate]") -> str:
        """Return which spaces of standard deviations were searched, in a line, or that those of the prior were not."""
        if windows is None:
            given = (
                ("--half-width", self.half_width), ("--heading-half-width-deg", self.heading_half_width_deg),
                ("--sigma-position", self.sigma_position),
            )  # fmt: skip
            instead = next((name for name, value in given if value is not None), "--track")
            return "" if prior.covariances is None else f"the prior's covariances are not used: {instead}"
        times = [epoch.raw.time for epoch in epochs if epoch.estimate is not None]
        covariances = [windows.prior.covariance_at(time, windows.max_gap) for time in times]
        known = [covariance for covariance in covariances if covariance is not None]
        source = "the prior's covariances" if self.sigma_position is None else "--sigma-position"
        if not known:
            return f"windows from {source}: none"
        found = [windows.space(covariance) for covariance in known]
        offsets = _range([space.half_width for space in found], "m")
        turns = _range([space.heading_half_width_deg for space in found], "degrees")
        n_cut = sum(windows.reach(covariance) > windows.largest_half_width for covariance in known)
        cut = f"; {n_cut} of them cut at {windows.largest_half_width:g} m" if n_cut else ""
        others = f"; {len(times) - len(known)} epochs without" if len(known) < len(times) else ""
        return f"windows from {source}: half width {offsets}, {turns}{cut}{others}"


def _in_steps(given: float | None, usual: float, step: float | None) -> float:
    """A half width, rounded up to whole steps; what makes no sense stays as it is, to be refused in words."""
    from maxcon.search.space import rounded_up

    reach = usual if given is None else given
    makes_sense = 0.0 <= reach < math.inf and (step is None or 0.0 < step < math.inf)
    return rounded_up(reach, step) if makes_sense else reach


def _variance(name: str, sigma: float, unit: float) -> float:
    variance = sigma * unit * sigma * unit
    if not (sigma >= 0.0 and variance < math.inf):
        raise OptionError(f"Expected {name} to be a finite standard deviation >= 0, got {sigma}.")
    return variance


def _with_covariance(prior: "Trajectory", covariance: list[list[float]]) -> "Trajectory":
    import numpy as np

    from maxcon.scan.trajectory import Trajectory

    return Trajectory(prior.times, prior.positions, prior.quaternions_xyzw, np.tile(covariance, (len(prior), 1, 1)))


def _range(values: list[float], unit: str) -> str:
    low, high = f"{min(values):.1f}", f"{max(values):.1f}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"
