# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Every figure from one sample input with hostile titles and values that are not defined; and what each refuses."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest

import maxcon
from drawn_figures import HOSTILE, BelowZero, assert_all_fits, parts, png_size, words, yard
from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import RiskCoverage
from maxcon.lab.paper.distinctness import Distinctnesses, plot_distinctness, plot_kurtosis_map
from maxcon.lab.paper.overview import plot_overview
from maxcon.lab.paper.search_spaces import ComparisonRow, plot_comparison, plot_headings, plot_search_spaces
from maxcon.lab.report.certainty_plots import SigmaPanel, plot_risk_coverage, plot_sigmas, plot_stanford
from maxcon.lab.report.errors import plot_error_distributions, plot_errors, plot_success
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.report.timeline import ErrorRow, plot_timeline
from maxcon.lab.study.prior_trials import TrialSummary
from maxcon.plotting.score_panel import SearchSpaceView

GENERATOR = np.random.default_rng(4)
ALONG = np.linspace(-8.0, 8.0, 40)
PLACES = np.column_stack([ALONG, 2.0 * np.sin(ALONG)])
ERRORS = np.where(np.arange(40) % 7, GENERATOR.rayleigh(0.1, 40), np.nan)
NAN = np.full(40, np.nan)
METHODS = {HOSTILE: ERRORS, "none": NAN, "exact": np.zeros(40)}
STATUSES = ["localized"] * 30 + ["ambiguous"] * 9 + ["a word of one's own"]


def views():
    accumulator = parts()["accumulator"]
    chosen = (maxcon.Count(), maxcon.Helmert(), BelowZero())
    return tuple(
        SearchSpaceView(accumulator, objective, HOSTILE if not n else "") for n, objective in enumerate(chosen)
    )


def risk(n_epochs, n_trusted, n_wrong):
    """So many epochs, the first of them trusted and the very first wrong."""
    place = np.arange(n_epochs)
    return RiskCoverage.of(place >= n_wrong, np.ones(n_epochs), place < n_trusted, GENERATOR.random(n_epochs))


def trials(names, n_right=7, n_wrong_but_good=1):
    return [
        TrialSummary(offset, offset, name, 10, n_right, n_right + n_wrong_but_good, n_wrong_but_good, 0.1, 12.0, 24.0)
        for offset in (3.0, 12.0)
        for name in names
    ]


def distinctnesses(n=40):
    kurtosis = np.where(np.arange(n) % 7, 1.0 + GENERATOR.exponential(9.0, n), np.nan)
    return Distinctnesses(GENERATOR.random(n), kurtosis, GENERATOR.gamma(3.0, 4.0, n), np.full(n, np.nan))


def trajectory(n=9):
    poses = [maxcon.Pose(float(x), 0.5, 0.0, 0.0, 0.0, 0.1 * x) for x in range(n)]
    return maxcon.Trajectory.from_poses(np.arange(float(n)), poses)


def others():
    """The same scan with the prior 2 m farther west: nothing is near enough to be found."""
    moved = replace(parts()["accumulator"], prior=yard().prior.translated([-2.0, 0.0, 0.0]))
    return [(moved, replace(parts()["estimate"], status=maxcon.Status.AT_RIM))]


def comparison_rows():
    far = maxcon.Pose(-12.34, 12.34, 0.0, 0.0, 0.0, np.radians(10.0))
    scan, point_map = yard().scan, yard().point_map
    return [ComparisonRow(HOSTILE, scan, point_map, pose, views()) for pose in (yard().reference, far)]


def rows(n_epochs=40):
    errors = np.where(np.arange(n_epochs) % 7, GENERATOR.normal(size=n_epochs), np.nan)
    none = np.full(n_epochs, np.nan)
    return [ErrorRow("along", "cm", errors, np.ones(n_epochs), 3.0 + none), ErrorRow("$x$", "m", errors, none, none)]


FIGURES = {
    "epoch": lambda path: maxcon.plot_epoch(path, **parts(), title=HOSTILE, reference=yard().reference),
    "poses": lambda path: maxcon.plot_poses(path, trajectory(), yard().point_map, prior=trajectory(2), title=HOSTILE),
    "drive": lambda path: maxcon.plot_drive(path, PLACES, ERRORS, point_map=yard().point_map, title=HOSTILE),
    "search spaces": lambda path: plot_search_spaces(path, views(), title=HOSTILE, reference=yard().reference),
    "headings": lambda path: plot_headings(
        path, parts()["accumulator"], maxcon.Count(), title=HOSTILE, reference=yard().reference
    ),
    "comparison": lambda path: plot_comparison(path, comparison_rows(), title=HOSTILE),
    "overview": lambda path: plot_overview(path, **parts(), others=others(), title=HOSTILE),
    "distinctness": lambda path: plot_distinctness(
        path, {HOSTILE: distinctnesses(), "other": distinctnesses()}, title=HOSTILE
    ),
    "kurtosis": lambda path: plot_kurtosis_map(
        path, PLACES, 1.0 + ERRORS, 9.0 + 9.0 * ERRORS, names=(HOSTILE, "B"), point_map=yard().point_map, title=HOSTILE
    ),
    "errors": lambda path: plot_errors(path, 1e9 + ALONG, {"<b> & c": ERRORS, "none": NAN, "exact": np.zeros(40)}),
    "distributions": lambda path: plot_error_distributions(path, METHODS),
    "success": lambda path: plot_success(
        path, {HOSTILE: np.abs(ALONG), "b": np.abs(ALONG[:30])}, {HOSTILE: ALONG > 0.0, "b": ALONG[:30] > 0.0}
    ),
    "sigmas": lambda path: plot_sigmas(
        path, [SigmaPanel(HOSTILE, "m", ERRORS, np.full(40, 0.01)), SigmaPanel("y", "cm", [0.0], [1.0])], title=HOSTILE
    ),
    "Stanford": lambda path: plot_stanford(
        path, {"x": ERRORS, "y": NAN}, {"x": np.full(40, 0.1), "y": ERRORS + 0.1}, title=HOSTILE
    ),
    "risk": lambda path: plot_risk_coverage(path, {HOSTILE: risk(30, 20, 1), "none": risk(1, 0, 1)}),
    "timeline": lambda path: plot_timeline(path, np.arange(40), STATUSES, ALONG > 7.0, rows(), title=HOSTILE),
    "prior error": lambda path: plot_prior_error(path, dict.fromkeys(["a", HOSTILE], trials(["b", HOSTILE]))),
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_drawn_and_says_what_it_was_given(name, tmp_path):
    FIGURES[name](tmp_path / "figure.svg")
    text = (tmp_path / "figure.svg").read_text("utf-8")
    assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<script>" not in text
    assert any(part in told for told in words(tmp_path / "figure.svg") for part in (HOSTILE, "<b> & c"))


@pytest.mark.parametrize("name", ["epoch", "overview", "distinctness", "sigmas", "timeline"])
def test_the_same_input_gives_the_same_bytes(name, tmp_path):
    for suffix in (".png", ".svg"):
        for stem in "ab":
            GENERATOR.bit_generator.state = np.random.default_rng(1).bit_generator.state
            FIGURES[name](tmp_path / f"{stem}{suffix}")
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
    assert min(png_size(tmp_path / "a.png")) > 500


@pytest.mark.parametrize("name", FIGURES)
def test_other_kinds_of_files_are_refused(name, tmp_path):
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg, got .*figure\.pdf"):
        FIGURES[name](tmp_path / "figure.pdf")
    assert list(tmp_path.iterdir()) == []


REFUSED = {
    "errors of 'a' to have shape (40,), got (3,)": lambda path: plot_errors(path, ALONG, {"a": [1.0, 2.0, 3.0]}),
    "to be 0 or more, got -1. Use NaN where it is not defined": lambda path: plot_errors(path, [0.0], {"a": [-1.0]}),
    "1 to 6 methods, got 0": lambda path: plot_errors(path, ALONG, {}),
    "`errors` to have shape (40,), got (1,)": lambda path: maxcon.plot_drive(path, PLACES, [0.0]),
    "errors of 'a' to have shape (n,), n > 0, got (0,)": lambda path: plot_error_distributions(path, {"a": []}),
    "same epochs of every method, got [1, 2] of them. Use NaN where a method has no answer": lambda path: (
        plot_error_distributions(path, {"a": [1.0], "b": [1.0, 1.0]})
    ),
    "1 to 8 methods, got 0": lambda path: plot_error_distributions(path, {}),
    "offsets of 'a' to be 0 or more, got -1": lambda path: plot_success(path, {"a": [-1.0]}, {"a": ALONG[:1] > 0}),
    "offsets of 'a' to be finite, got NaN": lambda path: plot_success(path, {"a": [np.nan]}, {"a": ALONG[:1] > 0}),
    "successes of 'a' to have shape (1,), got (2,)": lambda path: plot_success(
        path, {"a": [1.0]}, {"a": ALONG[:2] > 0}
    ),
    "1 to 4 panels, got 0": lambda path: plot_sigmas(path, [], title="T"),
    "error and sigma along, got none": lambda path: plot_sigmas(
        path, [SigmaPanel("along", "m", [1.0], [np.nan])], title="T"
    ),
    "errors and sigmas along of one shape, got (1,) and (2,)": lambda path: plot_sigmas(
        path, [SigmaPanel("along", "m", [1.0], [1.0, 1.0])], title="T"
    ),
    "sigmas along to be": lambda path: plot_sigmas(path, [SigmaPanel("along", "m", [1.0], [0.0])], title="T"),
    "errors and levels x of one shape, got (1,) and (2,)": lambda path: plot_stanford(
        path, {"x": [0.1]}, {"x": [0.1, 0.2]}, title="T"
    ),
    "levels of the same directions, got ['x'] and ['y']": lambda path: plot_stanford(
        path, {"x": [0.1]}, {"y": [0.1]}, title="T"
    ),
    "epochs of 'a', got none": lambda path: plot_risk_coverage(path, {"a": risk(0, 0, 0)}),
    "1 to 4 rows, got 0": lambda path: plot_timeline(path, [0], ["localized"], [False], [], title="T"),
    "each of n > 0 epochs, got (1,), 2 and (1,)": lambda path: plot_timeline(
        path, [0], ["localized"] * 2, [False], rows(1), title="T"
    ),
    "levels along of shape (1,), got (4,), (4,), (4,)": lambda path: plot_timeline(
        path, [0], ["localized"], [False], rows(4), title="T"
    ),
    "1 to 8 methods, got 9": lambda path: plot_prior_error(path, {"one": trials("abcdefghi")}),
    "1 to 4 drives, got 5": lambda path: plot_prior_error(path, dict.fromkeys("abcde", trials("a"))),
    "none of 'b' in 'two'. Finish its trials": lambda path: plot_prior_error(
        path, {"one": trials("ab"), "two": trials("a")}
    ),
    "same epochs of every method, got [7, 40] of them. Use NaN where a method has no value": lambda path: (
        plot_distinctness(path, {"a": distinctnesses(), "b": distinctnesses(7)}, title="T")
    ),
    "1 to 4 methods, got 5": lambda path: plot_distinctness(path, dict.fromkeys("abcde", distinctnesses()), title="T"),
    "the kurtosis to be 1 or more, got 0.5": lambda path: plot_kurtosis_map(
        path, PLACES[:1], [3.0], [0.5], names=("a", "b"), point_map=None, title="T"
    ),
    "`peak_ratio` to be from 0 to 1, got 1.2": lambda path: Distinctnesses([1.2], [3.0], [0.0], [0.0]),
    "`kurtosis` to be 1 or more, got -1.2": lambda path: Distinctnesses([0.5], [-1.2], [0.0], [0.0]),
    "`divergence` to be": lambda path: Distinctnesses([0.5], [3.0], [-0.1], [0.0]),
    "`spread` to be 0 or more, got inf": lambda path: Distinctnesses([0.5], [3.0], [0.0], [np.inf]),
    "`kurtosis` to have shape (2,), got (1,)": lambda path: Distinctnesses([0.1, 0.2], [3.0], [1.0] * 2, [0.0] * 2),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_drawn_is_refused(message, tmp_path):
    with pytest.raises((ArrayError, OptionError)) as refused:
        REFUSED[message](tmp_path / "figure.png")
    assert message in str(refused.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("positions", [np.empty((0, 2)), np.zeros((3, 4)), np.full((3, 2), np.nan), np.zeros(3)])
def test_positions_must_be_places(tmp_path, positions):
    values = [3.0] * len(positions)
    with pytest.raises(ArrayError, match="Expected `positions` to have shape"):
        maxcon.plot_drive(tmp_path / "drive.png", positions, values)
    with pytest.raises(ArrayError, match="Expected `positions` to have shape"):
        plot_kurtosis_map(tmp_path / "map.png", positions, values, values, names=("a", "b"), point_map=None, title="T")
    assert list(tmp_path.iterdir()) == []


ODD = {
    "one epoch without an answer": lambda path: plot_errors(path, [0.0], {"a": [np.nan]}),
    "a drive without an answer": lambda path: maxcon.plot_drive(path, PLACES, NAN),
    "one pose": lambda path: maxcon.plot_poses(path, trajectory(1), yard().point_map),
    "errors beyond the axis": lambda path: plot_error_distributions(path, {"a": [0.0, 0.01, 10.0, np.nan, 1e9]}),
    "an empty bin, no success": lambda path: plot_success(path, {"a": [0.1, 3.0]}, {"a": np.zeros(2, bool)}),
    "a huge error": lambda path: plot_sigmas(path, [SigmaPanel("x", "m", [1e9, 0.0], [0.01, 0.01])], title="T"),
    "no level": lambda path: plot_stanford(path, {"x": [0.0]}, {"x": [np.nan]}, title="T"),
    "all wrong": lambda path: plot_risk_coverage(path, {"a": risk(30, 30, 30)}),
    "one epoch": lambda path: plot_timeline(path, [7], ["localized"], [True], rows(1), title="T"),
    "two equal kurtoses": lambda path: (
        plot_kurtosis_map(path, PLACES[:2], [3.0] * 2, [3.0] * 2, names=("a", "b"), point_map=None, title="T")
    ),
    "no kurtosis": lambda path: (
        plot_kurtosis_map(path, PLACES, NAN, NAN, names=("a", "b"), point_map=None, title="T")
    ),
    "equal measures": lambda path: (
        plot_distinctness(path, {"a": Distinctnesses([0.0] * 7, [1.0] * 7, [0.0] * 7, [0.0] * 7)}, title="T")
    ),
    "no measures": lambda path: plot_distinctness(path, {"a": Distinctnesses(*[NAN] * 4)}, title="T"),
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ODD)
def test_odd_values_are_drawn(name, tmp_path):
    ODD[name](tmp_path / "figure.png")
    assert min(png_size(tmp_path / "figure.png")) > 300


def _certainty(n):
    """Errors, sigmas and statuses of a drive; a tenth is withheld, and a few answers are far off."""
    generator = np.random.default_rng(n)
    sigmas = np.exp(generator.normal(np.log(0.01), 0.3, (3, n)))
    errors = sigmas * generator.standard_normal((3, n))
    errors[0, :: max(n // 3, 2)] += 3.0
    said = ("localized", "ambiguous", "walls missing", "not confirmed", "at the rim", "unreadable scan")
    statuses = generator.choice(said, n, p=[0.9, 0.06, 0.01, 0.01, 0.01, 0.01])
    statuses[0] = "localized"
    sigmas[:, statuses != "localized"] = np.nan
    errors[:, statuses == "unreadable scan"] = np.nan
    return errors, sigmas, statuses


@pytest.mark.parametrize("n_epochs", [1, 3001])
def test_nothing_is_cut_off_in_figures_of_certainty(n_epochs, tmp_path, drawn):
    errors, sigmas, statuses = _certainty(n_epochs)
    panels = [SigmaPanel(f"kind {number}", "cm", errors[number], sigmas[number]) for number in range(3)]
    plot_sigmas(tmp_path / "sigmas.png", panels, title="Error against predicted sigma: a method")
    by_errors, by_levels = dict(along=errors[0], across=errors[1]), dict(along=3.0 * sigmas[0], across=40.0 * sigmas[1])
    plot_stanford(tmp_path / "stanford.png", by_errors, by_levels, title="Protection level against true error")
    levels = ErrorRow("along", "cm", 100.0 * errors[0], 100.0 * sigmas[0], 300.0 * sigmas[0])
    none = ErrorRow("heading", "°", errors[2], sigmas[2], np.full(n_epochs, np.nan))
    wrong = np.abs(errors[0]) > 0.3
    plot_timeline(
        tmp_path / "timeline.svg", np.arange(n_epochs), list(statuses), wrong, [levels, none], title="A drive"
    )
    assert (tmp_path / "timeline.svg").stat().st_size < 1_000_000  # many epochs are drawn as pixels
    found = RiskCoverage.of(~wrong, ~np.isnan(errors[0]), statuses == "localized", np.abs(errors[1]))
    for n_methods in (1, 8):
        names = [f"a method by a long name {number}" for number in range(n_methods)]
        plot_risk_coverage(tmp_path / "risk.png", dict.fromkeys(names, found))
    for figure in drawn:
        assert_all_fits(figure, panels_apart=False)


@pytest.mark.parametrize("n_headings", [1, 7, 61])
def test_nothing_is_cut_off_in_headings(n_headings, tmp_path, drawn):
    space = maxcon.SearchSpace(0.3, 0.06, 0.25 * (n_headings - 1), 0.5)
    accumulator = yard().accumulate(space)
    accumulator = replace(accumulator, moments=accumulator.moments * 1e6)
    plot_headings(
        tmp_path / "a.png", accumulator, maxcon.Count(), title="Epoch 1234: every heading", reference=yard().reference
    )
    maxcon.plot_epoch(tmp_path / "epoch.png", **yard().conclude(space), title="T", reference=yard().reference)
    assert drawn[0].get_size_inches()[0] == pytest.approx(9.6)
    assert_all_fits(drawn[0])


@pytest.mark.parametrize("n_shown", [1, 2, 3])
def test_nothing_is_cut_off_in_overview_and_comparison(n_shown, tmp_path, drawn):
    status = maxcon.Status.LOCALIZED if n_shown == 1 else maxcon.Status.NOT_CONVERGED
    given = yard().conclude(objective=BelowZero())
    given["estimate"] = replace(given["estimate"], status=status)
    moved = [replace(given["accumulator"], prior=yard().prior.translated([x, 0.0, 0.0])) for x in (-2.0, 2.0)]
    beside = [(accumulator, replace(given["estimate"], status=maxcon.Status.AT_RIM)) for accumulator in moved]
    title = "Epoch 1234 and its neighbours"
    plot_overview(tmp_path / "overview.png", **given, others=beside[: n_shown - 1], title=title)
    named = [replace(view, title=view.title and "Count, every map point") for view in views()[:n_shown]]
    shown = [replace(row, label="straight street, epoch 1234", views=tuple(named)) for row in comparison_rows()]
    plot_comparison(tmp_path / "a.png", shown, title="Count beside Helmert's score, from the reference")
    for figure in drawn:
        assert_all_fits(figure)
