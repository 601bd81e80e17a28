"""Points written as LAS or LAZ, in steps of a millimetre if nothing else is said."""

import laspy
import numpy as np
import pyproj


def write_las(path, points, *, classes=6, times=None, crs=None, scale=1e-3, point_format=6, version="1.4", extra=()):
    """Write points with a class and a gps_time each, or of all, if the format has one; return what laspy wrote."""
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, scale)
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    for name in extra:
        header.add_extra_dim(laspy.ExtraBytesParams(name, "float32"))
    las = laspy.LasData(header)
    las.xyz = points
    las.classification[:] = classes
    if times is not None and "gps_time" in header.point_format.dimension_names:
        las.gps_time[:] = times
    las.write(path)
    return las
