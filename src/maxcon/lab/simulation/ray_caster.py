# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rays cast into a scene."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MissingExtraError


class Hits(NamedTuple):
    """Where rays met triangles; rays that met nothing have triangle -1.

    ranges: shape (n,), float32; m; meaningless where nothing was met.
    triangles: shape (n,), int32; row of the triangle, or -1.
    """

    ranges: NDArray[np.float32]
    triangles: NDArray[np.int32]


def check_embreex() -> None:
    """Check that embreex is installed, before the work whose last step needs it."""
    try:
        import embreex  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "Expected embreex to cast rays in a simulated city, but it is not installed."
            " Run: pip install 'maxcon[demo]'"
        ) from error


class Caster(Protocol):
    """A scene that a scanner can cast its rays into.

    `normals`, shape (t, 3), and `classes`, shape (t,), are those of its triangles, to which `Hits.triangles` are rows.
    """

    @property
    def normals(self) -> NDArray[np.float32]: ...  # noqa: D102

    @property
    def classes(self) -> NDArray[np.uint8]: ...  # noqa: D102

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits: ...  # noqa: D102


class TriangleScene:
    """Triangles made ready for casting rays (Embree).

    corners: shape (t, 3, 3); of each triangle, m. Coordinates must be small: rays are cast in float32, whose steps are
        0.01 mm at 150 m.
    """

    def __init__(self, corners: NDArray[np.float64]) -> None:
        check_embreex()
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        self.normals: NDArray[np.float32] = (normals / np.where(lengths > 0.0, lengths, 1.0)).astype(np.float32)
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, corners.astype(np.float32))

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hit of each ray.

        origins, directions: shape (n, 3), float32; in the frame of the corners, m; unit directions.
        """
        found = self._scene.run(np.ascontiguousarray(origins), np.ascontiguousarray(directions), output=True)
        return Hits(found["tfar"], found["primID"])


class Surfaces(Protocol):
    """The surfaces of a world: triangles, shape (t, 3, 3), m, and the LasClass of each, shape (t,)."""

    @property
    def corners(self) -> NDArray[np.float64]: ...  # noqa: D102

    @property
    def classes(self) -> NDArray[np.uint8]: ...  # noqa: D102


class RayCaster:
    """A city or a suburb, made ready for casting rays.

    city: in city metres.
    """

    def __init__(self, city: Surfaces) -> None:
        self.city = city
        self._scene = TriangleScene(city.corners)

    @property
    def normals(self) -> NDArray[np.float32]:
        """Unit normal of each triangle, shape (t, 3); its sign has no meaning."""
        return self._scene.normals

    @property
    def classes(self) -> NDArray[np.uint8]:
        """LasClass of each triangle, shape (t,)."""
        return self.city.classes

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hit of each ray, origins and directions of shape (n, 3): see `TriangleScene.cast`."""
        return self._scene.cast(origins, directions)
