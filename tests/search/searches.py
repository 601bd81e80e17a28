"""What the tests of searches draw: seeds, options, normals, and an objective of a user's own."""

import numpy as np
from hypothesis import strategies as st

from maxcon.search import Multiplicity, Weighting

SEEDS = st.integers(0, 2**32)
OPTIONS = st.fixed_dictionaries(
    {"multiplicity": st.sampled_from(list(Multiplicity)), "weighting": st.sampled_from(list(Weighting))}
)


class OwnObjective:
    """One that knows no bounds; its score may be given."""

    def __init__(self, score=lambda moments: np.sqrt(moments[..., 1] * moments[..., 3])):
        self.score = score


def unit_vectors(rng, n, bare=0.1):
    """Normals of all directions; such a part of them is missing."""
    vectors = rng.normal(size=(n, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors[rng.random(n) < bare] = 0.0
    return vectors
