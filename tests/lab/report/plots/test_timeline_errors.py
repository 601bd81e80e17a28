# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from maxcon.errors import ArrayError
from maxcon.lab.report.plots.timeline_plot import ErrorDrawing, ErrorRow


def test_gross_errors_do_not_flatten_the_others():
    row = ErrorRow("along", "cm", [1.0, -2.0, 300.0, np.nan], [1.0, 1.0, 1.0, np.nan], [3.0, 3.0, 3.0, np.nan])
    assert ErrorDrawing.of(row, 4).limit == pytest.approx(1.25 * 4.0 * 3.0)


def test_the_range_holds_errors_bands_and_levels():
    row = ErrorRow("along", "cm", [0.5] * 3, [1.0] * 3, [3.0] * 3)
    assert ErrorDrawing.of(row, 3).limit == pytest.approx(1.25 * 3.0)
    assert ErrorDrawing.of(ErrorRow("along", "cm", [-4.0] * 3, [1.0] * 3), 3).limit == pytest.approx(1.25 * 4.0)
    nothing = ErrorDrawing.of(ErrorRow("along", "cm", [np.nan], [np.nan]), 1)
    assert nothing.limit > 0.0 and not nothing.has_sigmas and not nothing.has_levels


def test_a_row_that_does_not_fit_is_refused():
    with pytest.raises(ArrayError, match=r"sigmas and levels along of shape \(2,\), got \(1,\), \(1,\), \(2,\)"):
        ErrorDrawing.of(ErrorRow("along", "cm", [1.0], [1.0]), 2)
