"""Every figure from one input with hostile titles and values that are not defined; the numbers and marks in them."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

import maxcon
from drawn_figures import HOSTILE, BelowZero, assert_all_fits, parts, png_size, words, yard
from maxcon.errors import OptionError
from maxcon.lab.charts import METHOD_STYLES, draw_legend, draw_number_ticks, offset_words, scale_words
from maxcon.lab.evaluation import Quantiles, RiskCoverage
from maxcon.lab.paper.distinctness_plots import MEASURES, plot_distinctness, plot_kurtosis_map
from maxcon.lab.paper.search_spaces import ComparisonRow, plot_comparison, plot_overview
from maxcon.lab.report.certainty_plots import plot_risk_coverage, plot_sigmas, plot_stanford
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.report.study_statistics import percents_within, plot_error_distributions, plot_success, round_width
from maxcon.lab.report.timeline import ErrorRow, plot_timeline
from maxcon.lab.study import MethodStatistics
from maxcon.plotting.figure import saved_figure
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
    return [SearchSpaceView(accumulator, objective, HOSTILE if not n else "") for n, objective in enumerate(chosen)]


def risk(n_epochs, n_trusted, n_wrong):
    """So many epochs, the first of them trusted and the very first wrong."""
    place = np.arange(n_epochs)
    return RiskCoverage.of(place >= n_wrong, np.ones(n_epochs), place < n_trusted, place / n_epochs)


def levels(names):
    """Two levels: the first method right in 10 of 10 epochs, each other in one less; times by hand."""
    none = Quantiles.of([])
    measured = {
        name: none for name in MethodStatistics.__annotations__ if MethodStatistics.__annotations__[name] is Quantiles
    }
    return {
        f"{offset:g} m, {offset:g}°": [
            MethodStatistics(
                "", name, 10, 10, 10 - number, 10, number, {}, 0, 0,
                **measured | {"ms": Quantiles.of([100.0 * number + offset])},
            )
            for number, name in enumerate(names)
        ]
        for offset in (3.0, 12.0)
    }  # fmt: skip


def measures(n=40):
    kurtosis = np.where(np.arange(n) % 7, 1.0 + GENERATOR.exponential(9.0, n), np.nan)
    values = (GENERATOR.random(n), kurtosis, GENERATOR.gamma(3.0, 4.0, n), np.full(n, np.nan))
    return dict(zip(MEASURES, values, strict=True))


def trajectory(n=9):
    poses = [maxcon.Pose(float(x), 0.5, 0.0, 0.0, 0.0, 0.1 * x) for x in range(n)]
    return maxcon.Trajectory.from_poses(np.arange(float(n)), poses)


def others(*offsets):
    """The same scan with the prior so many metres farther east: nothing is near enough to be found."""
    unsure = replace(parts()["estimate"], status=maxcon.Status.AT_RIM)
    moved = [replace(parts()["accumulator"], prior=yard().prior.translated([x, 0.0, 0.0])) for x in offsets]
    return [(accumulator, unsure) for accumulator in moved]


def comparison_rows(n_views=3):
    far = maxcon.Pose(-12.34, 12.34, 0.0, 0.0, 0.0, np.radians(10.0))
    scan, point_map = yard().scan, yard().point_map
    return [ComparisonRow(HOSTILE, scan, point_map, pose, views()[:n_views]) for pose in (yard().reference, far)]


def rows(n_epochs=40):
    errors = np.where(np.arange(n_epochs) % 7, GENERATOR.normal(size=n_epochs), np.nan)
    none = np.full(n_epochs, np.nan)
    return [ErrorRow("along", "cm", errors, np.ones(n_epochs), 3.0 + none), ErrorRow("$x$", "m", errors, none, none)]


FIGURES = {
    "epoch": lambda path: maxcon.plot_epoch(path, **parts(), title=HOSTILE, reference=yard().reference),
    "poses": lambda path: maxcon.plot_poses(path, trajectory(), yard().point_map, prior=trajectory(2), title=HOSTILE),
    "drive": lambda path: maxcon.plot_drive(path, PLACES, ERRORS, point_map=yard().point_map, title=HOSTILE),
    "comparison": lambda path: plot_comparison(path, comparison_rows(), title=HOSTILE),
    "overview": lambda path: plot_overview(path, **parts(), others=others(-2.0), title=HOSTILE),
    "distinctness": lambda path: plot_distinctness(path, {HOSTILE: measures(), "other": measures()}, title=HOSTILE),
    "kurtosis": lambda path: plot_kurtosis_map(
        path, PLACES, (HOSTILE, 1.0 + ERRORS), ("B", 9.0 + 9.0 * ERRORS), point_map=yard().point_map, title=HOSTILE
    ),
    "distributions": lambda path: plot_error_distributions(path, METHODS),
    "success": lambda path: plot_success(
        path, {HOSTILE: (np.abs(ALONG), ALONG > 0.0), "b": (np.abs(ALONG[:30]), ALONG[:30] > 0.0)}
    ),
    "sigmas": lambda path: plot_sigmas(path, [ErrorRow(HOSTILE, "m", ERRORS, np.full(40, 0.01), NAN)], title=HOSTILE),
    "Stanford": lambda path: plot_stanford(
        path, {"x": ERRORS, "y": NAN}, {"x": np.full(40, 0.1), "y": ERRORS + 0.1}, title=HOSTILE
    ),
    "risk": lambda path: plot_risk_coverage(path, {HOSTILE: risk(30, 20, 1), "none": risk(1, 0, 1)}),
    "timeline": lambda path: plot_timeline(path, np.arange(40.0), STATUSES, ALONG > 7.0, rows(), title=HOSTILE),
    "prior error": lambda path: plot_prior_error(path, dict.fromkeys(["a", HOSTILE], levels(["b", HOSTILE]))),
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_says_what_it_was_given_and_is_the_same_again(name, tmp_path):
    for stem in "ab":
        GENERATOR.bit_generator.state = np.random.default_rng(1).bit_generator.state
        FIGURES[name](tmp_path / f"{stem}.svg")
    text = (tmp_path / "a.svg").read_text("utf-8")
    assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<script>" not in text
    assert any(HOSTILE in told for told in words(tmp_path / "a.svg"))
    assert (tmp_path / "b.svg").read_text("utf-8") == text


def test_other_kinds_of_files_are_refused(tmp_path):
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg, got .*figure\.pdf"):
        FIGURES["timeline"](tmp_path / "figure.pdf")
    assert list(tmp_path.iterdir()) == []


def array(*values):
    return np.array(values, float)


NO_MEASURES = dict.fromkeys(MEASURES, NAN)
EQUAL_MEASURES = {name: np.full(7, float(name == "kurtosis")) for name in MEASURES}
ODD = {
    "a drive without an answer": lambda path: maxcon.plot_drive(path, PLACES, NAN),
    "one pose": lambda path: maxcon.plot_poses(path, trajectory(1), yard().point_map),
    "errors beyond the axis": lambda path: plot_error_distributions(path, {"a": array(0.0, 0.01, 10.0, np.nan, 1e9)}),
    "an empty bin, no success": lambda path: plot_success(path, {"a": (array(0.1, 3.0), np.zeros(2, bool))}),
    "a huge error": lambda path: plot_sigmas(
        path, [ErrorRow("x", "m", array(1e9, 0.0), array(0.01, 0.01), NAN)], title="T"
    ),
    "no level": lambda path: plot_stanford(path, {"x": array(0.0)}, {"x": array(np.nan)}, title="T"),
    "all wrong": lambda path: plot_risk_coverage(path, {"a": risk(30, 30, 30)}),
    "one epoch": lambda path: plot_timeline(path, array(7), ["localized"], array(1) > 0.0, rows(1), title="T"),
    "two equal kurtoses": lambda path: plot_kurtosis_map(
        path, PLACES[:2], ("a", array(3.0, 3.0)), ("b", array(3.0, 3.0)), point_map=None, title="T"
    ),
    "no kurtosis": lambda path: plot_kurtosis_map(path, PLACES, ("a", NAN), ("b", NAN), point_map=None, title="T"),
    "equal measures": lambda path: plot_distinctness(path, {"a": EQUAL_MEASURES}, title="T"),
    "no measures": lambda path: plot_distinctness(path, {"a": NO_MEASURES}, title="T"),
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


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved, as they were drawn."""
    figures, save = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *to, **how: figures.append(self) or save(self, *to, **how))
    return figures


@pytest.mark.parametrize("n_epochs", [1, 1001])
def test_nothing_is_cut_off_in_figures_of_certainty(n_epochs, tmp_path, drawn):
    errors, sigmas, statuses = _certainty(n_epochs)
    panels = [ErrorRow(f"kind {number}", "cm", errors[number], sigmas[number], sigmas[number]) for number in range(3)]
    plot_sigmas(tmp_path / "sigmas.png", panels, title="Error against predicted sigma: a method")
    by_errors, by_levels = dict(along=errors[0], across=errors[1]), dict(along=3.0 * sigmas[0], across=40.0 * sigmas[1])
    plot_stanford(tmp_path / "stanford.png", by_errors, by_levels, title="Protection level against true error")
    levels = ErrorRow("along", "cm", 100.0 * errors[0], 100.0 * sigmas[0], 300.0 * sigmas[0])
    wrong, epochs = np.abs(errors[0]) > 0.3, np.arange(float(n_epochs))
    plot_timeline(tmp_path / "timeline.svg", epochs, list(statuses), wrong, [levels], title="A drive")
    assert (tmp_path / "timeline.svg").stat().st_size < 1_000_000  # many epochs are drawn as pixels
    found = RiskCoverage.of(~wrong, ~np.isnan(errors[0]), statuses == "localized", np.abs(errors[1]))
    names = [f"a method by a long name {number}" for number in range(8)]
    plot_risk_coverage(tmp_path / "risk.png", dict.fromkeys(names, found))
    for figure in drawn:
        assert_all_fits(figure, panels_apart=False)


@pytest.mark.parametrize("n_shown", [2, 3])
def test_nothing_is_cut_off_in_overview_and_comparison(n_shown, tmp_path, drawn):
    status = maxcon.Status.LOCALIZED if n_shown == 2 else maxcon.Status.NOT_CONVERGED
    given = yard().conclude(objective=BelowZero())
    given["estimate"] = replace(given["estimate"], status=status)
    beside = others(-2.0, 2.0)[: n_shown - 2]
    plot_overview(tmp_path / "overview.png", **given, others=beside, title="Epoch 1234 and its neighbours")
    named = [replace(view, title=view.title and "Count, every map point") for view in views()[:n_shown]]
    shown = [row._replace(label="street, epoch 1234", views=named) for row in comparison_rows()]
    plot_comparison(tmp_path / "a.png", shown, title="Count beside Helmert's score, from the reference")
    for figure in drawn:
        assert_all_fits(figure)


# --- the numbers in figures -----------------------------------------------------------------------------------


@given(st.lists(st.floats(0.0, 20.0) | st.just(np.nan), min_size=1), st.floats(0.0, 20.0))
def test_percents_count_what_they_say(errors, limit):
    expected = 100.0 * sum(error <= limit for error in errors) / len(errors)
    assert percents_within(np.array(errors), np.array([limit]))[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("farthest", "expected"), [(0.0, 0.5), (9.99, 0.5), (10.0, 1.0), (39.0, 2.0), (99.0, 5.0), (350.0, 20.0)]
)
def test_bins_are_of_round_width(farthest, expected):
    assert round_width(farthest) == expected


def told(path, draw):
    """What a figure says."""
    draw(path / "plot.svg")
    return words(path / "plot.svg")


def test_errors_and_success_are_counted(tmp_path):
    errors = {"Count": array(0.1, 0.5, np.nan, np.nan), "Helmert": array(0.1, 0.2, 0.3, 0.36)}
    written = told(tmp_path, lambda path: plot_error_distributions(path, errors))
    assert {"Count: 25.0 %, 2 without an answer", "Helmert: 75.0 %"} <= set(written)
    assert "Epochs: 4, those without an answer too. Dashed: success, 0.3 m. Below: shares within it." in written
    # Bins hold their lower edges.
    found = {"Count": (array(0.1, 0.5, 1.2), array(0, 1, 0) > 0), "Helmert": (array(0.1, 0.2, 1.2), array(1, 1, 1) > 0)}
    written = told(tmp_path, lambda path: plot_success(path, found))
    assert {"Count: 33.3 %", "Helmert: 100.0 %"} <= set(written)
    assert "Success: within 0.3 m and 1° of the reference. Bins of 0.5 m; bars: 95 % intervals." in written
    place = written.index("epochs")
    assert written[place - 3 : place] == ["1–2", "0–1", "1"]


def test_sigmas_levels_and_risk_are_counted(tmp_path):
    panel = error_row([0.5, -1.5, 2.5, 9.0, np.nan], np.ones(5), NAN)
    written = told(tmp_path, lambda path: plot_sigmas(path, [panel], title="T"))
    assert {"within: 25.0 · 50.0 · 75.0 % of 4", "predicted sigma [cm]"} <= set(written)
    errors = {"along": array(0.05, -0.1, 0.2, -0.5, 0.1, 0.9, 3.0, np.nan), "none": array(0.1)}
    levels = {"along": array(0.10, 0.10, 0.1, 0.10, 0.4, 0.4, np.nan, np.nan), "none": array(np.nan)}
    written = told(tmp_path, lambda path: plot_stanford(path, errors, levels, title="T"))
    at = written.index("nominal")
    assert written[at : at + 8] == ["nominal", "2", "misleading", "1", "hazardous", "1", "unavailable", "4"]
    assert any("Alert limit: 0.29 m." in each for each in written)
    assert "Errors above their level: 2 of 4 used epochs;" in written
    assert "proved with 95 % confidence: a rate of at most 90.2 %." in written
    assert "No epoch has a level within the alert limit:" in written
    found = {"maxcon": risk(1200, 1100, 0), "gicp-3m": risk(1200, 1000, 7)}
    written = told(tmp_path, lambda path: plot_risk_coverage(path, found))
    assert {"maxcon: 0 of 1,100", "gicp-3m: 7 of 1,000"} <= set(written)


def error_row(errors, sigmas, levels):
    return ErrorRow("along", "cm", *(np.array(values, float) for values in (errors, sigmas, levels)))


GROSS = error_row([1.0, -2.0, 300.0, np.nan], [1.0, 1.0, 1.0, np.nan], [3.0, 3.0, 3.0, np.nan])


def test_statuses_and_wrong_answers_are_counted(tmp_path):
    statuses, wrong = ["localized", "localized", "localized", "no match"], array(0, 0, 1, 1) > 0.0
    written = told(tmp_path, lambda path: plot_timeline(path, np.arange(4.0), statuses, wrong, [GROSS], title="T"))
    labels = {"localized: 3", "no match: 1", "trusted and wrong: 1", "±2 predicted sigmas", "protection level"}
    assert labels <= set(written)
    assert any("4 epochs. Trusted and wrong: 1 (0.3 m and 1°)." in each for each in written)
    row = error_row([1.0, -2.0], [np.nan] * 2, [np.nan] * 2)  # of a method that predicts nothing
    right = array(0, 0) > 0.0
    written = told(tmp_path, lambda path: plot_timeline(path, array(0, 50), ["localized"] * 2, right, [row], title="T"))
    assert any("No trusted answer is wrong" in each and "predicts no errors" in each for each in (" ".join(written),))
    assert not {"±2 predicted sigmas", "protection level"} & set(written)


def test_drives_methods_levels_and_times_are_named(tmp_path):
    found = levels(("maxcon", "count 1 m, then GICP", "my method"))
    written = " ".join(told(tmp_path, lambda path: plot_prior_error(path, {"one drive": found, "a $second$": found})))
    assert "one drive, 10 epochs" in written and "a $second$, 10 epochs" in written
    for label in ("maxcon: 12 ms", "count 1 m, then GICP: 110 ms", "my method: 210 ms", "12 m", "12°", "median [ms]"):
        assert label in written


@pytest.mark.parametrize("field", ["color", "line", "marker", "hatch"])
def test_each_mark_alone_tells_the_methods_apart(field):
    assert len({getattr(style, field) for style in METHOD_STYLES}) == 8


@pytest.mark.parametrize(
    ("labels", "expected"), [(["a"], 1), (["a"] * 4, 4), (["a"] * 5, 3), (["a" * 40] * 3, 2), (["a" * 80, "b"], 1)]
)
def test_legends_have_as_many_columns_as_fit(labels, expected, tmp_path):
    with saved_figure(tmp_path / "legend.png", 9.2, 3.0, "", "") as figure:
        handles = figure.subplots().plot(np.zeros((2, len(labels))))
        assert draw_legend(figure, handles, labels)._ncols == expected


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (1.8, 60.0, ["2", "5", "10", "20", "50"]),
        (0.01, 10.0, ["≤ 0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1", "2", "5", "10"]),
        (0.02, 50.0, ["0.1", "1", "10"]),
    ],
)
def test_ticks_are_round_numbers(tmp_path, low, high, expected):
    with saved_figure(tmp_path / "ticks.png", 4.0, 1.0, "", "") as figure:
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        draw_number_ticks(axes.xaxis, low, high, least=0.01)
        assert [label.get_text() for label in axes.get_xticklabels()] == expected


def test_offsets_and_scales_are_put_in_words():
    given = [-0.9, 2.824, -0.004, 0.0, -2.816]
    assert [offset_words(offset) for offset in given] == ["−0.90", "2.82", "0.00", "0.00", "−2.82"]
    accumulator = parts()["accumulator"]
    views = [SearchSpaceView(accumulator, maxcon.Helmert()), SearchSpaceView(accumulator, maxcon.Count())]
    assert scale_words(views) == "score, over the highest of the square"
    assert "from the lowest (0)" in scale_words([*views, SearchSpaceView(accumulator, BelowZero())])
