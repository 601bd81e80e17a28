"""A street for most tests of baselines."""

import pytest
from walled_streets import Street


@pytest.fixture(scope="session")
def street():
    """A street with walls across at uneven distances."""
    return Street().facades().pilasters([-21.0, -13.7, -6.1, 3.3, 9.4, 18.2])


@pytest.fixture(scope="session")
def street_map(street):
    return street.point_map


@pytest.fixture(scope="session")
def street_scan(street):
    return street.scan()
