"""Every figure from one sample input with hostile titles and values that are not defined; the numbers in them."""

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
from maxcon.lab.report import charts
from maxcon.lab.report import paper_figures as paper
from maxcon.lab.report.certainty_plots import ErrorRow, plot_stanford, plot_timeline
from maxcon.lab.report.charts import percents_within, plot_error_distributions
from maxcon.lab.report.prior_error import levels_of_distance, plot_prior_error, round_width
from maxcon.plotting.figure import saved_figure
from maxcon.plotting.score_panel import SearchSpaceView
from study_tables import rows_of

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


def row(prior_distance, is_success=True, **more):
    """An epoch of a study by the distance of its prior, m."""
    known = {"prior_distance": prior_distance, "is_success": is_success, "is_localized": True, "distance": 9.0}
    return known | {"status": "localized", "reference_x": 0.0, "ms": 7.0} | more


def measures(n=40):
    kurtosis = np.where(np.arange(n) % 7, 1.0 + GENERATOR.exponential(9.0, n), np.nan)
    values = (GENERATOR.random(n), kurtosis, GENERATOR.gamma(3.0, 4.0, n), np.full(n, np.nan))
    return dict(zip(paper.MEASURES, values, strict=True))


def trajectory(n=9):
    poses = [maxcon.Pose(float(x), 0.5, 0.0, 0.0, 0.0, 0.1 * x) for x in range(n)]
    return maxcon.Trajectory.from_poses(np.arange(float(n)), poses)


def comparison_rows(n_views=3):
    far = maxcon.Pose(-12.34, 12.34, 0.0, 0.0, 0.0, np.radians(10.0))
    scan, point_map = yard().scan, yard().point_map
    return [paper.ComparisonRow(HOSTILE, scan, point_map, pose, views()[:n_views]) for pose in (yard().reference, far)]


def rows(n_epochs=40):
    errors = np.where(np.arange(n_epochs) % 7, GENERATOR.normal(size=n_epochs), np.nan)
    none = np.full(n_epochs, np.nan)
    return [ErrorRow("along", "cm", errors, np.ones(n_epochs), 3.0 + none), ErrorRow("$x$", "m", errors, none, none)]


FIGURES = {
    "epoch": lambda path: maxcon.plot_epoch(path, **parts(), title=HOSTILE, reference=yard().reference),
    "poses": lambda path: maxcon.plot_poses(path, trajectory(), yard().point_map, prior=trajectory(2), title=HOSTILE),
    "drive": lambda path: maxcon.plot_drive(path, PLACES, ERRORS, point_map=yard().point_map, title=HOSTILE),
    "comparison": lambda path: paper.plot_comparison(path, comparison_rows(), title=HOSTILE),
    "distinctness": lambda path: paper.plot_distinctness(path, {HOSTILE: measures(), "b": measures()}, title=HOSTILE),
    "kurtosis": lambda path: paper.plot_kurtosis_map(
        path, PLACES, (HOSTILE, 1.0 + ERRORS), ("B", 9.0 + 9.0 * ERRORS), point_map=yard().point_map, title=HOSTILE
    ),
    "distributions": lambda path: plot_error_distributions(path, METHODS),
    "Stanford": lambda path: plot_stanford(
        path, {"x": ERRORS, "y": NAN}, {"x": np.full(40, 0.1), "y": ERRORS + 0.1}, title=HOSTILE
    ),
    "timeline": lambda path: plot_timeline(path, np.arange(40.0), STATUSES, ALONG > 7.0, rows(), title=HOSTILE),
    "prior error": lambda path: plot_prior_error(
        path, {HOSTILE: levels_of_distance(rows_of({name: [row(0.1), row(1.2)] for name in ("b", HOSTILE)}))}
    ),
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_says_what_it_was_given_and_is_the_same_again(name, tmp_path):
    for stem in "ab":
        GENERATOR.bit_generator.state = np.random.default_rng(1).bit_generator.state
        FIGURES[name](tmp_path / f"{stem}.svg")
    text = (tmp_path / "a.svg").read_text("utf-8")
    assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<script>" not in text and any(HOSTILE in told for told in words(tmp_path / "a.svg"))
    assert (tmp_path / "b.svg").read_text("utf-8") == text


def test_other_kinds_of_files_are_refused(tmp_path):
    with pytest.raises(OptionError, match=r"to end in \.png or \.svg, got .*figure\.pdf"):
        FIGURES["timeline"](tmp_path / "figure.pdf")
    assert list(tmp_path.iterdir()) == []


def array(*values):
    return np.array(values, float)


NO_MEASURES = dict.fromkeys(paper.MEASURES, NAN)
EQUAL_MEASURES = {name: np.full(7, float(name == "kurtosis")) for name in paper.MEASURES}
ODD = {
    "a drive without an answer": lambda path: maxcon.plot_drive(path, PLACES, NAN),
    "one pose": lambda path: maxcon.plot_poses(path, trajectory(1), yard().point_map),
    "errors beyond the axis": lambda path: plot_error_distributions(path, {"a": array(0.0, 0.01, 10.0, np.nan, 1e9)}),
    "no level": lambda path: plot_stanford(path, {"x": array(0.0)}, {"x": array(np.nan)}, title="T"),
    "one epoch": lambda path: plot_timeline(path, array(7), ["localized"], array(1) > 0.0, rows(1), title="T"),
    "two equal kurtoses": lambda path: paper.plot_kurtosis_map(
        path, PLACES[:2], ("a", array(3.0, 3.0)), ("b", array(3.0, 3.0)), point_map=None, title="T"
    ),
    "no kurtosis": lambda path: paper.plot_kurtosis_map(path, PLACES, ("a", NAN), ("b", NAN), point_map=None, title=""),
    "equal measures": lambda path: paper.plot_distinctness(path, {"a": EQUAL_MEASURES}, title="T"),
    "no measures": lambda path: paper.plot_distinctness(path, {"a": NO_MEASURES}, title="T"),
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ODD)
def test_odd_values_are_drawn(name, tmp_path):
    ODD[name](tmp_path / "figure.png")
    assert min(png_size(tmp_path / "figure.png")) > 300


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved, as they were drawn."""
    figures, save = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *to, **how: figures.append(self) or save(self, *to, **how))
    return figures


SAID = ("localized", "ambiguous", "walls missing", "not confirmed", "at the rim", "unreadable scan")


@pytest.mark.parametrize("n_epochs", [1, 1001])
def test_nothing_is_cut_off_in_figures_of_certainty(n_epochs, tmp_path, drawn):
    errors = 0.01 * np.random.default_rng(n_epochs).standard_normal(n_epochs)
    errors[:: max(n_epochs // 3, 2)] += 3.0  # a few are far off
    levels = {"along": np.full(n_epochs, 0.03), "across": np.full(n_epochs, 0.4)}
    title = "Protection level against true error"
    plot_stanford(tmp_path / "stanford.png", dict.fromkeys(levels, errors), levels, title=title)
    row = ErrorRow("along", "cm", 100.0 * errors, np.ones(n_epochs), np.full(n_epochs, 3.0))
    statuses, epochs = [SAID[number % 6] for number in range(n_epochs)], np.arange(float(n_epochs))
    plot_timeline(tmp_path / "timeline.svg", epochs, statuses, np.abs(errors) > 0.3, [row], title="A drive")
    assert (tmp_path / "timeline.svg").stat().st_size < 1_000_000  # many epochs are drawn as pixels
    for figure in drawn:
        assert_all_fits(figure, panels_apart=False)


@pytest.mark.parametrize("n_shown", [2, 3])
def test_nothing_is_cut_off_in_a_comparison(n_shown, tmp_path, drawn):
    named = [replace(view, title=view.title and "Count, every map point") for view in views()[:n_shown]]
    shown = [row._replace(label="street, epoch 1234", views=named) for row in comparison_rows()]
    paper.plot_comparison(tmp_path / "a.png", shown, title="Count beside Helmert's score, from the reference")
    for figure in drawn:
        assert_all_fits(figure)


# --- the numbers in figures ---
@given(st.lists(st.floats(0.0, 20.0) | st.just(np.nan), min_size=1), st.floats(0.0, 20.0))
def test_percents_count_what_they_say(errors, limit):
    expected = 100.0 * sum(error <= limit for error in errors) / len(errors)
    assert percents_within(np.array(errors), np.array([limit]))[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("farthest", "expected"), [(0.0, 0.5), (3.99, 0.5), (4.0, 1.0), (15.0, 2.0), (39.0, 5.0), (150.0, 20.0)]
)
def test_bins_are_of_round_width(farthest, expected):
    assert round_width(farthest) == expected


def test_errors_are_counted(tmp_path):
    errors = {"Count": array(0.1, 0.5, np.nan, np.nan), "Helmert": array(0.1, 0.2, 0.3, 0.36)}
    plot_error_distributions(tmp_path / "plot.svg", errors)
    written = words(tmp_path / "plot.svg")
    assert {"Count: 25.0 %, 2 without an answer", "Helmert: 75.0 %"} <= set(written)
    assert "Epochs: 4, those without an answer too. Dashed: success, 0.3 m. Below: shares within it." in written


def test_epochs_are_binned_by_the_distance_of_their_prior(tmp_path):
    """Bins hold their lower edges; what was not tried, or has no prior, is in none."""
    not_tried = row(0.3, status="unreadable scan")
    rows = rows_of({
        "count": [row(0.1, False), row(0.5), row(1.2, False)],
        "helmert": [row(0.1), row(0.2), row(1.2), not_tried, row(None)],
    })  # fmt: skip
    found = levels_of_distance({"Count": rows["count"], "Helmert": rows["helmert"]})
    counted = {name: [(one.method, one.n_success, one.n_epochs) for one in level] for name, level in found.items()}
    assert counted == {
        "0.5 m, 1–2 epochs": [("Count", 0, 1), ("Helmert", 2, 2)],
        "1 m, 1 epoch": [("Count", 1, 1)],
        "1.5 m, 1 epoch": [("Count", 0, 1), ("Helmert", 1, 1)],
    }
    plot_prior_error(tmp_path / "plot.svg", {"prior “gnss”": found})
    written = [line for text in words(tmp_path / "plot.svg") for line in text.split("\n")]
    assert {"prior “gnss”", "Count: 7 ms", "0.5 m", "1–2 epochs", "median [ms]"} <= set(written)
    assert levels_of_distance({"Count": rows["count"].where(np.zeros(3, bool))}) == {}


def test_levels_are_counted(tmp_path):
    errors = {"along": array(0.05, -0.1, 0.2, -0.5, 0.1, 0.9, 3.0, np.nan), "none": array(0.1)}
    levels = {"along": array(0.10, 0.10, 0.1, 0.10, 0.4, 0.4, np.nan, np.nan), "none": array(np.nan)}
    plot_stanford(tmp_path / "plot.svg", errors, levels, title="T")
    written = words(tmp_path / "plot.svg")
    at = written.index("nominal")
    assert written[at : at + 8] == ["nominal", "2", "misleading", "1", "hazardous", "1", "unavailable", "4"]
    assert any("Alert limit: 0.29 m." in each for each in written)
    assert "Errors above their level: 2 of 4 used epochs;" in written
    assert "proved with 95 % confidence: a rate of at most 90.2 %." in written
    assert "No epoch has a level within the alert limit:" in written


def test_statuses_and_wrong_answers_are_counted(tmp_path):
    path, statuses, wrong = tmp_path / "plot.svg", ["localized"] * 3 + ["no match"], array(0, 0, 1, 1) > 0.0
    row = ErrorRow("along", "cm", array(1, -2, 300, np.nan), array(1, 1, 1, np.nan), array(3, 3, 3, np.nan))
    plot_timeline(path, np.arange(4.0), statuses, wrong, [row], title="T")
    written = words(path)
    labels = {"localized: 3", "no match: 1", "trusted and wrong: 1", "±2 predicted sigmas", "protection level"}
    assert labels <= set(written)
    assert any("4 epochs. Trusted and wrong: 1 (0.3 m and 1°)." in each for each in written)
    row = ErrorRow("along", "cm", array(1, -2), NAN[:2], NAN[:2])  # of a method that predicts nothing
    plot_timeline(path, array(0, 50), statuses[:2], wrong[:2], [row], title="T")
    written = words(path)
    assert "No trusted answer is wrong" in " ".join(written) and "predicts no errors" in " ".join(written)
    assert not {"±2 predicted sigmas", "protection level"} & set(written)


# --- styles, legends and ticks ---
@pytest.mark.parametrize("field", ["color", "line", "marker", "hatch"])
def test_each_mark_alone_tells_the_methods_apart(field):
    assert len({getattr(style, field) for style in charts.METHOD_STYLES}) == 8


@pytest.mark.parametrize(
    ("labels", "expected"), [(["a"], 1), (["a"] * 4, 4), (["a"] * 5, 3), (["a" * 40] * 3, 2), (["a" * 80, "b"], 1)]
)
def test_legends_have_as_many_columns_as_fit(labels, expected, tmp_path):
    with saved_figure(tmp_path / "legend.png", 9.2, 3.0, "", "") as figure:
        handles = figure.subplots().plot(np.zeros((2, len(labels))))
        assert charts.draw_legend(figure, handles, labels)._ncols == expected


@pytest.mark.parametrize(("low", "high", "expected"), [
    (1.8, 60.0, ["2", "5", "10", "20", "50"]),
    (0.01, 10.0, ["≤ 0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1", "2", "5", "10"]),
    (0.02, 50.0, ["0.1", "1", "10"]),
])  # fmt: skip
def test_ticks_are_round_numbers(tmp_path, low, high, expected):
    with saved_figure(tmp_path / "ticks.png", 4.0, 1.0, "", "") as figure:
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        charts.draw_number_ticks(axes.xaxis, low, high, least=0.01)
        assert [label.get_text() for label in axes.get_xticklabels()] == expected
