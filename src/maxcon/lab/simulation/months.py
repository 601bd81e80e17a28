"""What months change in streets: trees are bare, houses have scaffolds or are gone, fences, snow and asphalt came."""

from collections import Counter
from collections.abc import Iterable, Iterator
from enum import StrEnum

import numpy as np

from maxcon.errors import OptionError
from maxcon.lab.simulation.drive import Seed
from maxcon.lab.simulation.furniture import OCTAGON, LasClass, Patch, boxes, grid_faces, join, prism, quads
from maxcon.lab.simulation.streets import KERB_HEIGHT, Frontage, StreetGrid


class Change(StrEnum):
    """What may have changed since the map."""

    BARE_TREE = "bare trees"
    SCAFFOLD = "scaffolds"
    DEMOLITION = "demolished houses"
    FENCE = "new fences"
    SNOW = "snow banks"
    ASPHALT = "roads 5 cm higher"


TWIGS = 10  # one of so many leaves stays, as a twig
DEMOLISHED = 0.25  # of the houses that change; the others have scaffolds
SCAFFOLD_OUT, SCAFFOLD_DEPTH = 1.0, 0.7
"""How far a scaffold stands out before the building line, m, farther before balconies; and how deep it is."""
KERB_PIECE = 12.0  # of a fence or a snow bank along the kerb, m
ASPHALT = 0.05  # m


class Months:
    """Draws what changes along one side of a street after the other; a larger share changes the same, and more.

    share: which part of the trees, houses, pieces of kerb and sides of roads changes, 0 to 1.
    changes: how many of each kind were drawn.
    """

    def __init__(self, share: float, seed: Seed) -> None:
        if not 0.0 <= share <= 1.0:
            raise OptionError(
                f"Expected the share that has changed since the map to be 0 to 1, got {share}."
                " With 0.3, three in ten houses, trees, kerbs and roads change."
            )
        self._share, self._rng = share, np.random.default_rng(seed)
        self.changes: Counter[Change] = Counter()

    def along(self, side: Frontage, parts: Iterable[Patch], grid: StreetGrid) -> Iterator[Patch]:
        """Yield what stands along `side` after the months: `parts` as they are or changed, then what is new."""
        for part in parts:
            rng = self._drawn() if part.classes[0] in (LasClass.HIGH_VEGETATION, LasClass.BUILDING) else None
            if rng is None:
                yield part
            elif part.classes[0] == LasClass.HIGH_VEGETATION:
                self.changes[Change.BARE_TREE] += 1
                yield _bare(part)
            else:
                yield from self._house(part, side, rng)
        for start in np.arange(grid.no_parking, side.length - grid.no_parking - KERB_PIECE, KERB_PIECE):
            if rng := self._drawn():
                change, draw = (Change.SNOW, draw_snow_bank) if rng.random() < 0.5 else (Change.FENCE, draw_fence)
                self.changes[change] += 1
                yield side.placed(draw(KERB_PIECE, rng), start, grid.sidewalk - 0.35)
        if self._drawn():
            self.changes[Change.ASPHALT] += 1
            x, y, z = side.length, grid.carriageway, ASPHALT - KERB_HEIGHT  # one side of the road, from the kerb on
            layer = quads([[[0.0, 0.0, z], [x, 0.0, z], [x, y, z], [0.0, y, z]]], LasClass.GROUND)
            yield side.placed(layer, 0.0, grid.sidewalk)

    def _drawn(self) -> np.random.Generator | None:
        """Whether the next thing changes: the generator of how, or None."""
        part, seed = self._rng.random(), self._rng.integers(2**32)
        return np.random.default_rng(seed) if part < self._share else None

    def _house(self, house: Patch, side: Frontage, rng: np.random.Generator) -> Iterator[Patch]:
        """Yield a house behind a scaffold, or the fence before the ground where it stood."""
        corners = side.local(house).corners.reshape(-1, 3)
        (start, _, _), (end, _, ridge) = corners.min(axis=0), corners.max(axis=0)
        if rng.random() < DEMOLISHED:
            self.changes[Change.DEMOLITION] += 1
            yield side.placed(draw_fence(end - start, rng), start, 0.3)
            return
        self.changes[Change.SCAFFOLD] += 1
        balconies = corners[corners[:, 2] > 3.0, 1].max() + 0.1
        scaffold = draw_scaffold(end - start, ridge - 3.0, rng)
        yield house
        yield side.placed(scaffold, start, max(SCAFFOLD_OUT, balconies))


def _bare(tree: Patch) -> Patch:
    """A tree without leaves: its trunk and some twigs."""
    n_trunk = len(prism(OCTAGON, 0.0, 1.0, LasClass.HIGH_VEGETATION))
    stays = (np.arange(len(tree)) < n_trunk) | (np.arange(len(tree)) % TWIGS == 0)
    return Patch(tree.corners[stays], tree.classes[stays])


def draw_scaffold(width: float, height: float, rng: np.random.Generator) -> Patch:
    """Return a scaffold before a front (m), one in two with tarpaulins; its outer side is at y = 0."""
    posts = np.linspace(0.05, width - 0.05, 1 + max(1, round(width / 2.5)))
    lows = [[x - 0.025, y - 0.025, 0.0] for x in posts for y in (-SCAFFOLD_DEPTH, 0.0)]
    highs = [[x + 0.025, y + 0.025, height] for x in posts for y in (-SCAFFOLD_DEPTH, 0.0)]
    for z in np.arange(2.0, height, 2.0):
        lows += [[0.0, -SCAFFOLD_DEPTH, z - 0.05], [0.0, -0.02, z + 0.5], [0.0, -0.02, z + 1.0]]
        highs += [[width, 0.0, z], [width, 0.02, z + 0.54], [width, 0.02, z + 1.04]]
    parts = [boxes(lows, highs, LasClass.UNCLASSIFIED)]
    if rng.random() < 0.5:
        hung = [[0.0, 0.04, 0.5], [width, 0.04, 0.5], [width, 0.04, height], [0.0, 0.04, height]]
        parts.append(quads([hung], LasClass.UNCLASSIFIED))
    return join(parts)


def draw_fence(length: float, rng: np.random.Generator) -> Patch:
    """Return a fence along x, 1.1 to 2 m high: of boards with gaps, or closed."""
    height, is_closed = rng.uniform(1.1, 2.0), rng.random() < 0.5
    tops = [height] if is_closed else np.arange(height, 0.2, -0.2)
    lows = [[0.0, -0.02, 0.05 if is_closed else top - 0.1] for top in tops]
    posts = np.arange(0.0, length, 2.5)
    lows += [[x, -0.06, 0.0] for x in posts]
    highs = [[length, 0.02, top] for top in tops] + [[x + 0.08, 0.02, height] for x in posts]
    return boxes(lows, highs, LasClass.UNCLASSIFIED)


def draw_snow_bank(length: float, rng: np.random.Generator) -> Patch:
    """Return what a plough leaves along the kerb, about 1 m wide and 0.3 to 0.9 m high."""
    along, across = np.linspace(0.0, length, 1 + round(length / 0.5)), np.array([-0.5, -0.2, 0.2, 0.5])
    x, y = np.meshgrid(along, across, indexing="ij")
    grid = np.stack([x, y, np.zeros_like(x)], axis=2)
    grid[1:-1, 1:3, 2] = rng.uniform(0.3, 0.9, (len(along) - 2, 2))
    return quads(grid_faces(grid), LasClass.UNCLASSIFIED)
