# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
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
