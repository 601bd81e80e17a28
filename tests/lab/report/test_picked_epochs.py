from maxcon._system.resumable import describe
from maxcon.lab.report.study_scenes import pick_epochs, space_of
from maxcon.search.space import SearchSpace
from study_tables import rows_of

GOOD = {"is_success": True, "distance": 0.05, "kurtosis": 2.0}
STREET = GOOD | {"kurtosis": 1.8}
LOST = {"is_success": False, "distance": 2.96, "kurtosis": 30.0}


def picked(*count, helmert=GOOD):
    """Epochs picked where the count has these rows, and Helmert's score the same row in each epoch."""
    rows = rows_of({"count": count, "helmert": [helmert] * len(count)})
    return pick_epochs(rows["count"], rows["helmert"])


def test_pictures_show_the_most_distinct_and_the_worst_epoch_of_which_the_whole_neighbourhood_was_searched():
    assert picked(GOOD, GOOD | {"kurtosis": 7.0}, STREET, LOST) == {"crossing": 1, "street": 2, "count fails": 3}
    assert picked(GOOD, STREET) == {"crossing": 0, "street": 1}  # there may be none where the count fails
    at_rim = GOOD | {"kurtosis": 9.0, "prior_distance": 2.9}
    assert picked(at_rim, GOOD | {"prior_distance": 1.0}) == {"crossing": 1, "street": 1}
    assert picked(LOST, helmert=LOST) == {}  # where nothing succeeds


def test_the_search_space_is_read_from_the_configuration():
    space = SearchSpace(1.2, 0.12, 1.0, 0.25)
    assert space_of({"mine": {"method": {"class": "Mine", "space": describe(space)}}}, "mine") == space
    assert space_of({}, "mine") is None
