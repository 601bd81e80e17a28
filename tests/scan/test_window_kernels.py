"""Angles of a scan against numpy, windows tried first against their definition, and planes of a block against each."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maxcon.scan import window_kernels as rules
from maxcon.scan.plane_kernels import BLOCK, covariance, plane_normal, plane_normals
from maxcon.scan.window_kernels import BANDS, WINDOWS, azimuths_of, elevations_of, first_windows

COORDINATES = st.one_of(
    st.floats(-1e3, 1e3), st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-17, -1e-17, 5e-324, 1e-200, 1e300])
)


@given(arrays(np.float64, st.tuples(st.integers(0, 40), st.just(3)), elements=COORDINATES))
def test_angles_are_those_of_numpy(points):
    with np.errstate(over="ignore"):
        level = np.sqrt(points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1])
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    for angles, expected in (
        (elevations, np.arctan2(points[:, 2], level)),
        (azimuths, np.arctan2(points[:, 1], points[:, 0])),
    ):
        np.testing.assert_allclose(angles, expected, rtol=5e-16, atol=1e-323)
        np.testing.assert_array_equal(np.signbit(angles), np.signbit(expected))
        assert (np.abs(angles) <= np.pi).all()


def window_of(elevations, k, width):
    """Number of the lowest window around one of some elevations, rad, with points enough, of more than one ring."""
    for number, reach in enumerate(WINDOWS):
        inside = elevations[np.abs(elevations - elevations[k]) <= reach]
        is_enough = len(inside) >= 3 and len(inside) * reach / width >= rules.LEAST_NEIGHBOURS
        if is_enough and inside.std() >= rules.LEAST_SPREAD * reach:
            return number
    return len(WINDOWS)


def window_for_most(windows):
    """Number of the window that is high enough for FIRST_SHARE of a sample; the highest if there is none."""
    shares = [(windows <= number).sum() > rules.FIRST_SHARE * len(windows) for number in range(len(WINDOWS) - 1)]
    return shares.index(True) if any(shares) else len(WINDOWS) - 1


def windows_by_definition(elevations, azimuths):
    """Numbers of the windows tried first in each band, from a sample of strips of azimuth."""
    n_columns = min(max(len(elevations) // rules.STRIP_POINTS, 8), rules.MOST_COLUMNS)
    columns = np.minimum((azimuths + np.pi) / (2.0 * np.pi) * n_columns, n_columns - 1).astype(int)
    sample, windows = [], []
    for column in range(0, n_columns, -(-n_columns // rules.MOST_STRIPS)):
        strip = np.sort(elevations[columns == column])
        step = 1 + len(strip) // (8 * rules.STRIP_POINTS)
        strip = strip[::step]
        sample.extend(strip)
        windows.extend(window_of(strip, k, 2.0 * np.pi / n_columns / step) for k in range(len(strip)))
    share = (np.array(sample) - elevations.min()) / max(np.ptp(elevations), 1e-9)
    bands, windows = np.minimum((share * BANDS).astype(int), BANDS - 1), np.array(windows)
    overall = window_for_most(windows)
    in_bands = [windows[bands == band] for band in range(BANDS)]
    return [max(overall, window_for_most(band)) if len(band) >= rules.LEAST_VOTES else overall for band in in_bands]


@given(
    st.integers(0, 2**32), st.integers(1, 3000), st.sampled_from([0, 1, 8, 16, 64]), st.sampled_from([0.0, 1e-4, 3e-3]),
    st.sampled_from([0.02, 0.3, np.pi]),
)  # fmt: skip
def test_windows_are_as_defined(seed, n, n_rings, smear, half_width):
    """Without rings, elevations lie anyhow."""
    rng = np.random.default_rng(seed)
    rings = rng.uniform(-0.4, 0.3, n_rings) if n_rings else rng.uniform(-0.4, 0.3, n)
    elevations = rng.choice(rings, n) + rng.normal(0.0, smear, n)
    azimuths = rng.uniform(-half_width, half_width, n)
    first = np.full(BANDS, -1)
    lowest = first_windows(elevations, azimuths, elevations.min(), elevations.max(), first)
    assert first.tolist() == windows_by_definition(elevations, azimuths) and lowest == first.min()


def moments_of(points):
    """Count, sums and sums of products, as `covariance` takes them."""
    products = points.T @ points
    return len(points), points.sum(axis=0), products[np.triu_indices(3)]


def flat_neighbourhood(rng, n, share, middle_share):
    """Points whose covariance has eigenvalues about 1, middle_share and share * middle_share, turned anyhow."""
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    sizes = np.sqrt([1.0, middle_share, share * middle_share])
    return rng.normal(size=(n, 3)) * sizes @ turned + rng.normal(size=3)


@given(st.integers(0, 2**32), st.integers(1, BLOCK), st.sampled_from([0.0, 1e-3, 0.1, 0.3, 1.0]))
@example(43373, 11, 0.0)
def test_a_block_of_planes_is_the_plane_of_each(seed, n, share):
    rng = np.random.default_rng(seed)
    moments, planes = np.full(10 * BLOCK, np.nan), np.full(5 * BLOCK, np.nan)
    each = []
    for k in range(n):
        points = flat_neighbourhood(rng, int(rng.integers(6, 50)), share, 10.0 ** rng.uniform(-2, 0))
        count, sums, outers = moments_of(points)
        moments.reshape(10, BLOCK)[:, k] = [count, *sums, *outers]
        matrix, normal = np.empty((3, 3)), np.empty(3)
        covariance(count, sums, outers, matrix)
        each.append((*plane_normal(matrix, normal)[:2], normal))
    plane_normals(n, moments, planes)
    for k, (smallest, middle, normal) in enumerate(each):
        found = planes.reshape(5, BLOCK)[:, k]
        if smallest < 0.5 * middle:
            rounding = 1e-12  # of eigenvalues, the largest of which is about 1: the definition takes an arc cosine
            np.testing.assert_allclose(found[:2], [smallest, middle], rtol=0.0, atol=1e-10 * middle + rounding)
            np.testing.assert_allclose(np.linalg.norm(np.cross(found[2:], normal)), 0.0, atol=1e-9 + rounding / middle)
            np.testing.assert_allclose(np.linalg.norm(found[2:]), 1.0, atol=1e-14)
        else:
            assert not found[0] < 0.45 * found[1]


def test_points_on_a_line_or_at_one_place_make_no_plane():
    rng = np.random.default_rng(0)
    for _ in range(20):
        moments, planes = np.zeros(10 * BLOCK), np.zeros(5 * BLOCK)
        for k in range(BLOCK):
            along = rng.normal(size=(20, 1)) * (k % 2)
            count, sums, outers = moments_of(along * rng.normal(size=3) + rng.normal(size=3))
            moments.reshape(10, BLOCK)[:, k] = [count, *sums, *outers]
        plane_normals(BLOCK, moments, planes)
        assert not (planes.reshape(5, BLOCK)[1] > 1e-6).any()
