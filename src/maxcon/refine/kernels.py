"""Compiled: least squares of the distances of scan points from planes of the map, and points grouped by surface."""

import numpy as np

from maxcon._system.kernel_cache import njit

# Cubes along an axis that have a number each: 400 km of 3 m. FACTOR, a large odd number, mixes the bits of a hash.
CUBES = np.int64(2**17)
FACTOR = 0x9E3779B97F4A7C15
PRECISION = 0.01
"""No distance is known better than this, m: where the pose takes up nearly all of a pattern, its size is not known."""


@njit(nogil=True, cache=True)
def rotation_and_axes(angles):
    """R = Rz(heading) Ry(pitch) Rx(roll) of (roll, pitch, heading), rad; and their axes, rows, (3, 3), map frame."""
    cr, sr = np.cos(angles[0]), np.sin(angles[0])
    cp, sp = np.cos(angles[1]), np.sin(angles[1])
    ch, sh = np.cos(angles[2]), np.sin(angles[2])
    rotation, axes = np.empty((3, 3)), np.zeros((3, 3))
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = -sp, cp * sr, cp * cr
    axes[0, 0], axes[0, 1], axes[0, 2] = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    axes[1, 0], axes[1, 1] = -sh, ch
    axes[2, 2] = 1.0
    return rotation, axes


@njit(nogil=True, cache=True, inline="always")
def turned(R, point):
    """Return R applied to a point (x, y, z): where it lies from the sensor, map axes, m."""
    x, y, z = point
    dx = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
    dy = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    dz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    return dx, dy, dz


@njit(nogil=True, cache=True, inline="always")
def _distance(away, normal, offset, unknowns):
    """Signed distance of a point from its plane, m: `away` from the sensor, map axes; the plane is n . r = offset."""
    (dx, dy, dz), (nx, ny, nz) = away, normal
    return offset - nx * (dx + unknowns[0]) - ny * (dy + unknowns[1]) - nz * (dz + unknowns[2])


@njit(nogil=True, cache=True, inline="always")
def _turn_gradient(axes, away, normal):
    """Derivatives of n . d by roll, pitch and heading, for a point d away from the sensor: n . (axis x d), m."""
    (dx, dy, dz), (nx, ny, nz) = away, normal
    # n . (axis x d) = axis . (d x n)
    cx, cy, cz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    return axes[0, 0] * cx + axes[0, 1] * cy + axes[0, 2] * cz, axes[1, 0] * cx + axes[1, 1] * cy, cz


@njit(nogil=True, cache=True)
def _equations(points, planes, unknowns, gate, equations):
    """Signed distances of points from their planes, and minus their derivatives, times the root of Tukey's weight.

    points : (3, n), sensor frame, m; planes : (4, n); unknowns : (6,); gate : no weight from this distance on, m;
    equations : (7, n), out: a row for each of x, y, z, roll, pitch, heading, then the distances.
    """
    R, axes = rotation_and_axes(unknowns[3:])
    for i in range(points.shape[1]):
        nx, ny, nz = planes[0, i], planes[1, i], planes[2, i]
        away = turned(R, (points[0, i], points[1, i], points[2, i]))
        distance = _distance(away, (nx, ny, nz), planes[3, i], unknowns)
        share = distance / gate
        root = max(1.0 - share * share, 0.0)
        roll, pitch, heading = _turn_gradient(axes, away, (nx, ny, nz))
        equations[0, i], equations[1, i], equations[2, i] = root * nx, root * ny, root * nz
        equations[3, i], equations[4, i], equations[5, i] = root * roll, root * pitch, root * heading
        equations[6, i] = root * distance


@njit(nogil=True, cache=True, fastmath={"reassoc", "contract"})
def _products(equations, products):
    """Write the scalar products of all rows of `equations`, (7, n), with each other, (7, 7)."""
    for j in range(7):
        for k in range(j, 7):
            total = 0.0
            for i in range(equations.shape[1]):
                total += equations[j, i] * equations[k, i]
            products[j, k] = products[k, j] = total


@njit(nogil=True, cache=True)
def _with_planes(points, planes):
    """The points that have a plane, and their planes, as columns: (3, m) and (4, m); and their numbers, (m,)."""
    numbers = np.empty(points.shape[0], np.int64)
    m = 0
    for i in range(points.shape[0]):
        if planes[i, 0] != 0.0 or planes[i, 1] != 0.0 or planes[i, 2] != 0.0:
            numbers[m] = i
            m += 1
    numbers = numbers[:m]
    used_points, used_planes = np.empty((3, m)), np.empty((4, m))
    for k in range(m):
        for axis in range(3):
            used_points[axis, k] = points[numbers[k], axis]
        for axis in range(4):
            used_planes[axis, k] = planes[numbers[k], axis]
    return used_points, used_planes, numbers


@njit(nogil=True, cache=True)
def adjust(points, planes, unknowns, start, start_weights, gate, n_steps, at_rest):
    """Take Gauss-Newton steps that reduce the distances n . r of points from their planes, with Tukey's weights.

    points : (n, 3), sensor frame, m; planes : (n, 4), as `find_partners` made them; unknowns : (6,), x, y, z, roll,
    pitch, heading, m and rad, in and out; start : (6,), an observation of them, with weights start_weights : (6,);
    gate : no weight from this distance on, m; n_steps : at most so many; at_rest : a step that moves less, m, and turns
    less than a hundredth of it, rad, is the last.
    """
    used_points, used_planes, numbers = _with_planes(points, planes)
    equations, products = np.empty((7, len(numbers))), np.empty((7, 7))
    for _ in range(n_steps):
        _equations(used_points, used_planes, unknowns, gate, equations)
        _products(equations, products)
        right_side = products[:6, 6] - start_weights * (unknowns - start)
        step = np.linalg.solve(products[:6, :6] + np.diag(start_weights), right_side)
        unknowns += step
        if np.abs(step[:3]).max() < at_rest and np.abs(step[3:]).max() < 0.01 * at_rest:
            break


@njit(nogil=True, cache=True)
def weigh(points, planes, unknowns, gate, normal_matrix, residuals, weights):
    """Write normal matrix, residuals and weights at an adjusted pose; points, planes, unknowns, gate as for `adjust`.

    Out: normal_matrix : (6, 6), without the start; residuals : (n,), m, infinite without a plane; weights : (n,), 0
    without one.
    """
    used_points, used_planes, numbers = _with_planes(points, planes)
    equations, products = np.empty((7, len(numbers))), np.empty((7, 7))
    _equations(used_points, used_planes, unknowns, gate, equations)
    _products(equations, products)
    normal_matrix[:] = products[:6, :6]
    residuals[:], weights[:] = np.inf, 0.0
    R, _ = rotation_and_axes(unknowns[3:])
    for k in range(len(numbers)):
        away = turned(R, (used_points[0, k], used_points[1, k], used_points[2, k]))
        normal = used_planes[0, k], used_planes[1, k], used_planes[2, k]
        distance = _distance(away, normal, used_planes[3, k], unknowns)
        residuals[numbers[k]] = distance
        root = max(1.0 - (distance / gate) ** 2, 0.0)
        weights[numbers[k]] = root * root


@njit(nogil=True, cache=True)
def sum_gradients(points, planes, groups, unknowns, factors, sums):
    """Add factor times minus the gradient, by the unknowns, of each point's distance from its plane to its group's sum.

    points : (n, 3), sensor frame, m; planes : (n, 4); groups : (n,), numbers, below 0 for none; unknowns : (6,), the
    pose; factors : (n,); sums : (n_groups, 6), in zeros, out.
    """
    R, axes = rotation_and_axes(unknowns[3:])
    for i in range(points.shape[0]):
        group = groups[i]
        if group < 0:
            continue
        normal = planes[i, 0], planes[i, 1], planes[i, 2]
        away = turned(R, (points[i, 0], points[i, 1], points[i, 2]))
        roll, pitch, heading = _turn_gradient(axes, away, normal)
        sums[group, 0] += factors[i] * normal[0]
        sums[group, 1] += factors[i] * normal[1]
        sums[group, 2] += factors[i] * normal[2]
        sums[group, 3] += factors[i] * roll
        sums[group, 4] += factors[i] * pitch
        sums[group, 5] += factors[i] * heading


@njit(nogil=True, cache=True)
def find_effects(points, planes, groups, unknowns, gate, start_weights, directions, sizes, variances, shifts):
    """Find sizes of patterns, each alone as one more unknown of the adjustment, and how the pose shifts with them.

    points : (n, 3), sensor frame, m, of which each has a plane, (n, 4), and a group, (n,): points that are off
    together; unknowns : (6,), the pose; gate : no weight from this distance on, m; start_weights : (6,), of the start
    as an observation; directions : (k, n, 3), how a unit of each pattern moves the points, sensor frame. Out:
    sizes, variances : (k,); shifts : (6, k), of the unknowns for a unit of each.
    """
    (k, n, _), (R, _) = directions.shape, rotation_and_axes(unknowns[3:])
    equations, own = np.empty((7, n)), np.zeros((k, n))
    _equations(points.T, planes.T, unknowns, gate, equations)
    by_pose, distances = equations[:6], equations[6]
    for axis in range(3):
        for i in range(n):
            along = by_pose[0, i] * R[0, axis] + by_pose[1, i] * R[1, axis] + by_pose[2, i] * R[2, axis]
            for j in range(k):
                own[j, i] -= along * directions[j, i, axis]
    shifts[:] = -np.linalg.solve(by_pose @ by_pose.T + np.diag(start_weights), by_pose @ own.T)
    own += shifts.T @ by_pose  # what the pose cannot take up
    sums = np.zeros(groups.max() + 1 if n > 0 else 1)
    for j in range(k):
        information = max((own[j] * own[j]).sum(), 1e-9)
        sizes[j] = (own[j] * distances).sum() / information
        sums[:] = 0.0
        for i in range(n):
            sums[groups[i]] += own[j, i] * (distances[i] - own[j, i] * sizes[j])
        variances[j] = (sums * sums).sum() / information**2 + PRECISION**2 / information


@njit(nogil=True, cache=True)
def next_distances(points, normals, n_next, within):
    """Distances, (m,), m, from each point's plane of those of the next `n_next` that are nearer than `within`, m.

    points, normals : (n, 3), in the order of a scan; zeros where there is no normal.
    """
    distances, n_found = np.empty(n_next * points.shape[0]), 0
    for i in range(points.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        for k in range(i + 1, min(i + 1 + n_next, points.shape[0])):
            dx, dy, dz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
            if dx * dx + dy * dy + dz * dz < within * within:
                distances[n_found] = abs(nx * dx + ny * dy + nz * dz)
                n_found += 1
    return distances[:n_found]


@njit(nogil=True, cache=True)
def _bounds(n):
    """Unit vectors on the borders between the n sectors of a half turn, (n - 1, 2)."""
    bounds = np.empty((n - 1, 2))
    for k in range(n - 1):
        azimuth = (k + 1) * np.pi / n
        bounds[k, 0], bounds[k, 1] = np.cos(azimuth), np.sin(azimuth)
    return bounds


@njit(nogil=True, cache=True)
def _sector(x, y, bounds):
    """Number of the sector of a half turn in which a direction or its opposite lies, and whether it is the opposite."""
    is_opposite = y < 0.0 or (y == 0.0 and x < 0.0)
    if is_opposite:
        x, y = -x, -y
    sector = 0
    for k in range(bounds.shape[0]):
        sector += bounds[k, 0] * y >= bounds[k, 1] * x
    return sector, is_opposite


@njit(nogil=True, cache=True)
def _number(key, table, keys, n):
    """Number of a key among the first `n` of `keys`, `n` if it is added; `table` (2^k,) of numbers, -1 where free."""
    mask = np.uint64(table.shape[0] - 1)
    slot = ((np.uint64(key) * np.uint64(FACTOR)) >> np.uint64(32)) & mask
    while table[slot] >= 0:
        if keys[table[slot]] == key:
            return table[slot]
        slot = (slot + np.uint64(1)) & mask
    table[slot], keys[n] = n, key
    return n


@njit(nogil=True, cache=True)
def number_groups(points, planes, weights, position, edge, n_bins, steepest, clusters, walls):
    """Number the clusters (points of one orientation bin in one cube) and the walls (of one bin, at one distance).

    For `covariance`. The distance is that of the plane from the sensor. points : (n, 3), sensor frame, m; planes :
    (n, 4), as `find_partners` made them; weights : (n,), points with 0 are in no group; position : (3,), of the sensor,
    map frame, m; edge : of a cube, and of a step of distance, m; n_bins : by azimuth, an even number; steepest :
    vertical part of a normal beyond which it faces up or down. clusters, walls : (n,), out, number of each point's, -1
    for none. Returns how many clusters and how many walls there are.
    """
    n_used = np.count_nonzero(weights)
    size = 16
    while size < 2 * n_used:
        size *= 2
    cluster_table, wall_table = np.full(size, np.int32(-1)), np.full(size, np.int32(-1))
    cluster_keys, wall_keys = np.empty(n_used, np.int64), np.empty(n_used, np.int64)
    bounds = _bounds(n_bins // 2)
    n_clusters, n_walls = 0, 0
    for i in range(points.shape[0]):
        clusters[i] = walls[i] = -1
        if weights[i] == 0.0:
            continue
        nx, ny, nz, offset = planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3]
        own_bin = np.int64(n_bins)
        if abs(nz) <= steepest:
            sector, is_opposite = _sector(nx, ny, bounds)
            own_bin = sector + n_bins // 2 * is_opposite
        key = own_bin
        for axis in range(3):
            key = key * CUBES + np.int64(np.floor(points[i, axis] / edge)) + CUBES // 2
        clusters[i] = _number(key, cluster_table, cluster_keys, n_clusters)
        n_clusters = max(n_clusters, clusters[i] + 1)
        depth = (offset - nx * position[0] - ny * position[1] - nz * position[2]) / edge
        key = own_bin * CUBES + np.int64(np.floor(depth)) + CUBES // 2
        walls[i] = _number(key, wall_table, wall_keys, n_walls)
        n_walls = max(n_walls, walls[i] + 1)
    return n_clusters, n_walls


@njit(nogil=True, cache=True)
def count_walls(normals, residuals, rotation, level, found_within, n_points, n_found):
    """Count the wall points of each orientation bin, and those of them that lie on a plane of the map.

    normals : (n, 3), sensor frame, zeros for none; residuals : (n,), m, infinite without a plane; rotation : (3, 3),
    R_map_sensor; level : vertical part of a normal from which on it is no wall's; found_within : largest residual of a
    point on its plane, m; n_points, n_found : (n_bins,) int64, equal sectors of a half turn, in zeros, out.
    """
    bounds = _bounds(n_points.shape[0])
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        nz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        if (x == 0.0 and y == 0.0 and z == 0.0) or abs(nz) >= level:
            continue
        nx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
        ny = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
        own_bin, _ = _sector(nx, ny, bounds)
        n_points[own_bin] += 1
        n_found[own_bin] += abs(residuals[i]) <= found_within
