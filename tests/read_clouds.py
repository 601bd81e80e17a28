"""Point clouds read as a whole, for tests."""

from types import SimpleNamespace

import numpy as np

from maxcon.io.clouds import open_cloud

POINTS = np.random.default_rng(6).uniform(4e5, 6e6, (7, 3))


def read_cloud(path, max_points=1_000_000, bounds=None):
    """Header, chunks, and all points, normals, classes and times."""
    with open_cloud(path) as reader:
        header, chunks = reader.header, list(reader.chunks(max_points, bounds))
    assert all(0 < len(chunk.points) <= max_points for chunk in chunks)
    if bounds is None:
        assert sum(len(chunk.points) for chunk in chunks) == header.n_points
    arrays = {"points": np.empty((0, 3))}
    for name in ("points", "normals", "classes", "times") if chunks else ():
        parts = [getattr(chunk, name) for chunk in chunks]
        arrays[name] = None if parts[0] is None else np.concatenate(parts)
    return SimpleNamespace(header=header, chunks=chunks, sizes=[len(chunk.points) for chunk in chunks], **arrays)


def assert_all_there(cloud, normals, classes, times):
    """Check that a cloud of POINTS was read in chunks of three, with everything that goes with them."""
    header = cloud.header
    assert (header.crs, header.has_normals, header.has_classes, header.has_times) == (None, True, True, True)
    assert cloud.sizes == [3, 3, 1]
    wanted = {"points": POINTS, "normals": normals, "classes": classes, "times": times}
    for name, values in wanted.items():
        np.testing.assert_array_equal(getattr(cloud, name), values)
        assert getattr(cloud, name).dtype == (np.uint8 if name == "classes" else np.float64)
