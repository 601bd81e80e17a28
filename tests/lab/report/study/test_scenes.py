# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
from maxcon.drive.poses_dataset import describe
from maxcon.lab.report.study_pictures import space_of
from maxcon.search.space import SearchSpace


def test_the_search_space_is_read_from_the_configuration():
    space = SearchSpace(1.2, 0.12, 1.0, 0.25)
    assert space_of({"mine": {"method": {"class": "Mine", "space": describe(space)}}}, "mine") == space
    assert space_of({}, "mine") is None
