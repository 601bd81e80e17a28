# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import maxcon
from maxcon.plotting.canvas.objective_names import title_of, unit_of


class MyObjective:
    def score(self, moments):
        return moments[..., 0] - 3.0


def test_objectives_have_names_and_a_users_own_has_its_classs():
    assert unit_of(maxcon.Helmert()) == "1/tr Q"
    assert (title_of(maxcon.Count()), unit_of(maxcon.Count())) == ("Count", "matches")
    assert (title_of(MyObjective()), unit_of(MyObjective())) == ("MyObjective", "score")
