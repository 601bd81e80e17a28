# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The scanners by name: layers and columns of their data sheets."""

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import RotatingScanner, ScannerLayout


@pytest.mark.parametrize(
    ("name", "n_layers", "lowest", "highest", "n_columns"),
    [
        ("vlp-16", 16, -15.0, 15.0, 1800),
        ("vlp-32c", 32, -25.0, 15.0, 1800),
        ("hdl-64e", 64, -24.33, 2.0, 2083),
        ("os1-64", 64, -22.5, 22.5, 1024),
    ],
)
def test_layers_and_columns(name, n_layers, lowest, highest, n_columns):
    scanner = ScannerLayout.parse(name).scanner()
    elevations = np.degrees(scanner.elevations)
    assert len(elevations) == n_layers
    assert (np.diff(elevations) > 0.0).all()
    np.testing.assert_allclose(elevations[[0, -1]], [lowest, highest])
    assert scanner.n_columns == n_columns
    assert scanner.directions.shape == (n_columns * n_layers, 3)


def test_vlp_32c_is_dense_about_the_horizon():
    elevations = np.degrees(ScannerLayout.VLP_32C.scanner().elevations)
    assert (np.abs(elevations) < 3.5).sum() == 18
    np.testing.assert_allclose(elevations[20], 0.0)
    np.testing.assert_allclose(elevations[[1, 30]], [-15.639, 10.333])


def test_hdl_64e_has_two_blocks():
    steps = np.diff(np.degrees(ScannerLayout.HDL_64E.scanner().elevations))
    np.testing.assert_allclose(steps[:32], 0.5, atol=1e-3)
    np.testing.assert_allclose(steps[32:], 1.0 / 3.0, atol=1e-3)


def test_the_default_is_a_vlp_16():
    assert ScannerLayout.VLP_16.scanner() == RotatingScanner()


def test_wrong_names_and_elevations_are_refused():
    with pytest.raises(OptionError, match=r"Expected `scanner` to be 'vlp-16', .* got 'vlp16'"):
        ScannerLayout.parse("vlp16")
    with pytest.raises(OptionError, match="Expected rising elevations"):
        RotatingScanner(elevations_deg=(1.0, 0.0))
    with pytest.raises(OptionError, match="Expected rising elevations of -90 to 90 degrees"):
        RotatingScanner(elevations_deg=(0.0, 91.0))
