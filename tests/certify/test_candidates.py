"""The ladders of search and proof, against what they promise."""

import math
from collections.abc import Iterator
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.certify.candidates import edge, first, gallop, preferred, rising

SOME = st.lists(st.one_of(st.none(), st.integers(-5, 5)))


@given(SOME)
def test_the_first_that_is_proved_ends_the_search(found):
    asked = []

    def candidates() -> Iterator[int | None]:
        for each in found:
            asked.append(each)
            yield each

    answer = first(candidates())
    proved = [each for each in found if each is not None]
    assert answer == (proved[0] if proved else None)
    assert asked == found[: len(asked)]
    assert all(each is None for each in asked[:-1])


@given(SOME)
def test_what_is_preferred_is_the_first_wanted_else_the_first(found):
    proved = [each for each in found if each is not None]
    even = [each for each in proved if not each % 2]
    one = proved[0] if proved else None
    assert preferred(found, lambda each: not each % 2) == (even[0] if even else one, one)


@given(st.lists(st.floats(0, 100), min_size=1), st.sampled_from([0.0, 0.01, 0.5]))
def test_a_climb_goes_on_while_it_gains(values, gain):
    kept = list(rising(values, float, gain))
    assert kept == values[: len(kept)]
    assert all(b > a * (1 + gain) for a, b in pairwise(kept))
    if len(kept) < len(values):
        assert not values[len(kept)] > kept[-1] * (1 + gain)


@given(st.floats(0.01, 99.99), st.booleans())
def test_the_edge_is_between_what_holds_and_what_does_not(threshold, geometric):
    tried = []

    def holds(value: float) -> bool:
        tried.append(value)
        return value < threshold

    low, high = edge(holds, 0.01, 100.0, 20, geometric=geometric)
    assert low <= threshold <= high
    assert len(tried) == 20
    assert all(0.01 < value < 100 for value in tried)
    size = math.log(high / low) / math.log(1e4) if geometric else (high - low) / 99.99
    assert size == pytest.approx(2.0**-20, rel=1e-6)


def test_a_close_edge_ends_the_halving():
    low, high = edge(lambda value: value < math.pi, 0.0, 8.0, 1000, close=1e-3)
    assert low < math.pi <= high
    assert 0.4e-3 < (high - low) / high <= 1e-3


@given(st.integers(0, 200), st.integers(0, 220), st.integers(1, 8))
def test_the_first_place_that_holds_is_found(count, threshold, close):
    """Where all from one place on hold; and in few tries."""
    seen = []

    def holds(place: int) -> bool:
        seen.append(place)
        return place >= threshold

    gallop(count, holds, close)
    assert len(set(seen)) == len(seen) <= close + 2 * max(1, count).bit_length()
    assert all(0 <= place < count for place in seen)
    if threshold < count:
        assert threshold in seen
    elif count:
        assert count - 1 in seen
