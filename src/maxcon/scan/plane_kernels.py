"""Compiled: the plane through points, from their second moments.

`covariance` and `plane_normal` are the definition; `sum_near` and `plane_normals` do it block by block, vectorized.
"""

import numpy as np

from maxcon._system.kernel_cache import njit

# Neighbourhoods in a block. Its moments: BLOCK counts, then BLOCK sums of x, of y, of z, of xx, xy, xz, yy, yz, zz.
BLOCK = 64
# Newton steps from 0 to the smallest eigenvalue: exact to the last digits where it is below half the middle one.
NEWTON_STEPS = 7


@njit(nogil=True, cache=True)
def covariance(count, sums, outers, matrix):
    """Covariance matrix (3, 3), out, of `count` points from sums (3,) and sums of products xx, xy, xz, yy, yz, zz."""
    mean_x, mean_y, mean_z = sums[0] / count, sums[1] / count, sums[2] / count
    matrix[0, 0] = outers[0] / count - mean_x * mean_x
    matrix[0, 1] = matrix[1, 0] = outers[1] / count - mean_x * mean_y
    matrix[0, 2] = matrix[2, 0] = outers[2] / count - mean_x * mean_z
    matrix[1, 1] = outers[3] / count - mean_y * mean_y
    matrix[1, 2] = matrix[2, 1] = outers[4] / count - mean_y * mean_z
    matrix[2, 2] = outers[5] / count - mean_z * mean_z


@njit(nogil=True, cache=True)
def plane_normal(matrix, normal):
    """Write the eigenvector of a covariance matrix's smallest eigenvalue; return all three eigenvalues, ascending.

    By the trigonometric solution of the characteristic cubic; the vector is the largest cross product of two rows of
    (matrix - eigenvalue I). normal : (3,) float64, out, zeros where every direction is the same.
    """
    normal[:] = 0.0
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
    a, b, c = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    spread = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if spread <= 1e-12 * abs(mean) or spread == 0.0:
        return mean, mean, mean
    d, e, f = matrix[0, 1], matrix[0, 2], matrix[1, 2]
    determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    angle = np.arccos(min(1.0, max(-1.0, determinant / (2.0 * spread**3)))) / 3.0
    largest = mean + 2.0 * spread * np.cos(angle)
    smallest = mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0)
    middle = 3.0 * mean - largest - smallest
    _null_vector(matrix, smallest, normal)
    return smallest, middle, largest


@njit(nogil=True, cache=True)
def _null_vector(matrix, eigenvalue, vector):
    """Write the eigenvector, (3,), of an eigenvalue: at right angles to all rows of (matrix - eigenvalue I)."""
    best = 0.0
    for i in range(3):
        j = (i + 1) % 3
        ax, ay, az = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        bx, by, bz = matrix[j, 0], matrix[j, 1], matrix[j, 2]
        if i == 0:
            ax -= eigenvalue
            by -= eigenvalue
        elif i == 1:
            ay -= eigenvalue
            bz -= eigenvalue
        else:
            az -= eigenvalue
            bx -= eigenvalue
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        squared = x * x + y * y + z * z
        if squared > best:
            best = squared
            length = np.sqrt(squared)
            vector[0], vector[1], vector[2] = x / length, y / length, z / length


@njit(nogil=True, cache=True, fastmath={"reassoc", "nsz", "contract"})
def sum_near(candidates, stride, n, x0, y0, z0, gate, moments, place):
    """Write the moments, about a point (x0, y0, z0), of those candidates that lie within `gate` (m) of it.

    candidates : flat float64, x of n candidates, from `stride` on y, from 2 `stride` on z, m; moments : (10 BLOCK,)
    float64, out at `place` of the block. Sums may be reordered, but always in the same way.
    """
    squared_gate = gate * gate
    count = 0.0
    sum_x = sum_y = sum_z = 0.0
    xx = xy = xz = yy = yz = zz = 0.0
    for k in range(n):
        x, y, z = candidates[k] - x0, candidates[stride + k] - y0, candidates[2 * stride + k] - z0
        is_near = x * x + y * y + z * z <= squared_gate
        x = x if is_near else 0.0
        y = y if is_near else 0.0
        z = z if is_near else 0.0
        count += 1.0 if is_near else 0.0
        sum_x += x
        sum_y += y
        sum_z += z
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
    moments[place] = count
    moments[BLOCK + place], moments[2 * BLOCK + place], moments[3 * BLOCK + place] = sum_x, sum_y, sum_z
    moments[4 * BLOCK + place], moments[5 * BLOCK + place], moments[6 * BLOCK + place] = xx, xy, xz
    moments[7 * BLOCK + place], moments[8 * BLOCK + place], moments[9 * BLOCK + place] = yy, yz, zz


@njit(nogil=True, cache=True, forceinline=True)
def _covariance_in_block(moments, k):
    """Covariance of neighbourhood k of a block, from its moments: xx, xy, xz, yy, yz, zz."""
    share = 1.0 / moments[k]
    mean_x, mean_y = moments[BLOCK + k] * share, moments[2 * BLOCK + k] * share
    mean_z = moments[3 * BLOCK + k] * share
    return (
        moments[4 * BLOCK + k] * share - mean_x * mean_x,
        moments[5 * BLOCK + k] * share - mean_x * mean_y,
        moments[6 * BLOCK + k] * share - mean_x * mean_z,
        moments[7 * BLOCK + k] * share - mean_y * mean_y,
        moments[8 * BLOCK + k] * share - mean_y * mean_z,
        moments[9 * BLOCK + k] * share - mean_z * mean_z,
    )


@njit(nogil=True, cache=True)
def plane_normals(n, moments, planes):
    """Find smallest and middle eigenvalue, and the eigenvector of the smallest, of n covariance matrices.

    As `covariance` and `plane_normal`, up to rounding, where the smallest eigenvalue is at most half the middle one;
    elsewhere the values only tell that it is more. NaN where all points coincide. Newton's steps on the characteristic
    polynomial climb from 0 to its smallest root. moments : (10 BLOCK,); planes : (5 BLOCK,), out.
    """
    for k in range(n):
        xx, xy, xz, yy, yz, zz = _covariance_in_block(moments, k)
        trace = xx + yy + zz
        minor_x, minor_y, minor_z = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
        minors = minor_x + minor_y + minor_z
        determinant = xx * minor_x - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        smallest = 0.0
        for _ in range(NEWTON_STEPS):
            slope = (3.0 * smallest - 2.0 * trace) * smallest + minors
            smallest -= (((smallest - trace) * smallest + minors) * smallest - determinant) / slope
        smallest = max(smallest, 0.0)
        others = trace - smallest
        product = minors - smallest * others
        middle = 2.0 * product / (others + np.sqrt(max(others * others - 4.0 * product, 0.0)))
        # The adjugate of (matrix - smallest I) is the vector times itself: its column with the largest diagonal.
        xx, yy, zz = xx - smallest, yy - smallest, zz - smallest
        ax, ay, az = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
        by, bz = xx * zz - xz * xz, xy * xz - xx * yz
        cz = xx * yy - xy * xy
        is_second, is_third = by > ax, cz > max(ax, by)
        x = az if is_third else (ay if is_second else ax)
        y = bz if is_third else (by if is_second else ay)
        z = cz if is_third else (bz if is_second else az)
        scale = 1.0 / np.sqrt(x * x + y * y + z * z)
        planes[k], planes[BLOCK + k] = smallest, middle
        planes[2 * BLOCK + k], planes[3 * BLOCK + k], planes[4 * BLOCK + k] = x * scale, y * scale, z * scale


@njit(nogil=True, cache=True)
def squares_across(n, points, moments, squares):
    """Write the mean square deviation across the rings of n neighbourhoods, m^2, as the sensor sees them.

    The deviation in elevation from the best straight line over azimuth: a single ring has next to none, however noisy
    its ranges are. points : (3 BLOCK,), x, then y, then z, m; moments : (10 BLOCK,); squares : (BLOCK,), out.
    """
    for k in range(n):
        x, y, z = points[k], points[BLOCK + k], points[2 * BLOCK + k]
        xx, xy, xz, yy, yz, zz = _covariance_in_block(moments, k)
        # Directions of rising elevation, (up_x, up_y, up_z), and along the ring, (-y, x, 0): orthogonal, of any length.
        square = x * x + y * y
        up_x, up_y, up_z = -x * z, -y * z, square
        a, b = xx * up_x + xy * up_y + xz * up_z, xy * up_x + yy * up_y + yz * up_z
        c = xz * up_x + yz * up_y + zz * up_z
        both = x * b - y * a
        along = y * y * xx - 2.0 * x * y * xy + x * x * yy
        across = up_x * a + up_y * b + up_z * c - both * both / max(along, 1e-12 * square)
        squares[k] = across / (square * (square + z * z))
