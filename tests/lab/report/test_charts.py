import numpy as np
import pytest

from maxcon.lab.report.charts import METHOD_STYLES, draw_legend, draw_number_ticks
from maxcon.plotting.figure import saved_figure


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
        draw_number_ticks(axes.xaxis, low, high, least=0.01)
        assert [label.get_text() for label in axes.get_xticklabels()] == expected
