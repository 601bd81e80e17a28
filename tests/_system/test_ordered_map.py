# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Results come in the order of what they are made of, however they are done."""

from concurrent.futures import ThreadPoolExecutor

from hypothesis import given
from hypothesis import strategies as st

from maxcon._system.ordered_map import in_order_of, ordered_map


@given(st.permutations(range(12)))
def test_results_that_come_in_any_order_are_put_in_order(order):
    is_ended = []

    def coming():
        yield from ((number, number**2) for number in order)
        is_ended.append(True)

    assert list(in_order_of(range(12), coming())) == [number**2 for number in range(12)]
    assert is_ended == [True]


def test_a_result_is_yielded_as_soon_as_those_before_it_were():
    asked = []

    def coming():
        for number in (1, 0, 2):
            asked.append(number)
            yield number, number

    results = in_order_of(range(3), coming())
    assert next(results) == 0
    assert asked == [1, 0]


@given(st.integers(0, 30), st.integers(1, 5), st.integers(1, 9))
def test_threads_yield_in_order_and_begin_no_more_than_they_may(n, n_threads, n_ahead):
    begun = []

    def work(number):
        begun.append(number)
        return -number

    with ThreadPoolExecutor(n_threads) as pool:
        for number, result in enumerate(ordered_map(pool, work, range(n), n_ahead)):
            assert result == -number
            assert len(begun) <= number + n_ahead
    assert sorted(begun) == list(range(n))
