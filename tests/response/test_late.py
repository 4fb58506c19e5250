"""How late an input acts: read as it is written, rounded up, or refused in one line."""

from fractions import Fraction

import numpy as np
import pytest

from polefence import InputError
from polefence.response.discrete import Sampling
from polefence.response.late import Late


@pytest.mark.parametrize("delay", [0.3, np.float64(0.3), Fraction(3, 10)])
def test_a_delay_is_what_it_reads_as(delay):
    late = Late.by(delay)
    assert (late.samples, late.whole, late.early) == (Fraction(3, 10), 1, Fraction(7, 10))
    assert Sampling(0.01, delay).lateness == late


def test_whole_delays_are_not_early():
    for delay in (0, 1, 2.0, np.int64(3)):
        late = Late.by(delay)
        assert (late.whole, late.early) == (delay, 0)


@pytest.mark.parametrize("delay", [-1, 65, float("nan"), float("inf"), "soon", None])
def test_others_are_refused_by_both(delay):
    for made in (Late.by, lambda own: Sampling(0.01, own)):
        with pytest.raises(InputError, match="delay = .* must be .* samples") as said:
            made(delay)
        assert "\n" not in str(said.value)
