# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What was announced is fetched once, in the background; what goes wrong there is said to who asks."""

import threading

import pytest
from maxcon.map.storage.ahead import FetchAhead

from maxcon.map.storage import RecordPlace, ahead

PLACES = [RecordPlace("tiles/0", number, 10, b"") for number in range(40)]


class Source:
    """Counts what is fetched and kept; waits until it may answer."""

    def __init__(self):
        self.fetched, self.kept, self.may_answer = [], [], threading.Event()
        self.is_asked = threading.Event()

    def fetch(self, place):
        self.fetched.append(place)
        self.is_asked.set()
        assert self.may_answer.wait(60)
        if place.offset == 13:
            raise OSError(5, "unlucky")
        return memoryview(bytes([place.offset]))

    def keep(self, place, content):
        self.kept.append(place)


@pytest.fixture
def source():
    source = Source()
    yield source
    source.may_answer.set()


def test_each_is_fetched_once_and_kept(source):
    source.may_answer.set()
    fetching = FetchAhead(source.fetch, source.keep)
    for _ in range(3):
        fetching.announce(PLACES[:10])
    for place in PLACES[:12]:  # two were not announced
        assert bytes(fetching.take(place)) == bytes([place.offset])
    assert sorted(place.offset for place in source.fetched) == list(range(12))


def test_who_asks_first_is_served_first(source):
    fetching = FetchAhead(source.fetch, source.keep)
    fetching.announce(PLACES[:30])
    source.is_asked.wait(60)
    source.may_answer.set()
    assert bytes(fetching.take(PLACES[29])) == bytes([29])


def test_an_error_is_that_of_who_asks(source):
    source.may_answer.set()
    fetching = FetchAhead(source.fetch, source.keep)
    fetching.announce(PLACES[10:16])
    with pytest.raises(OSError, match="unlucky"):
        fetching.take(PLACES[13])
    assert bytes(fetching.take(PLACES[14])) == bytes([14])
    with pytest.raises(OSError, match="unlucky"):  # asked again, it is tried again
        fetching.take(PLACES[13])


def test_what_cannot_be_kept_is_said(source, monkeypatch):
    source.may_answer.set()
    called = threading.Event()

    def keep(place, content):
        called.set()
        raise OSError(28, "no space")

    fetching = FetchAhead(source.fetch, keep)
    with pytest.raises(OSError, match="no space"):
        fetching.take(PLACES[0])


def test_what_nobody_asks_for_is_given_up(source, monkeypatch):
    monkeypatch.setattr(ahead, "MOST_BYTES", 50)
    fetching = FetchAhead(source.fetch, source.keep)
    fetching.announce(PLACES)
    assert list(fetching._begun) == PLACES[-5:]
    assert fetching._n_bytes == 50
    source.may_answer.set()
    assert bytes(fetching.take(PLACES[0])) == b"\0"
