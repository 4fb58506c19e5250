"""How fast a loop decays for periods in any order: proved, near the truth, and no more than it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.proof.claims.base import prove
from polefence.proof.claims.decay import power_below
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError

LAW = pf.FixedGain(np.array([[-3.75, -11.5]]))


@pytest.fixture(scope="module")
def analysed():
    """The published loop, of periods of 0.4 to 0.6 s."""
    A, B, E = [[0, 1], [0, "-1/10"]], [[0], ["1/10"]], [[0], [1]]
    plant = pf.UncertainPlant.from_vertices([A], [B], [E])
    seen = pf.at_sample_time(plant, Fraction(1, 2), 0, jitter=Fraction(1, 5))
    return pf.analyse(seen, LAW, pf.Disk(0, 1), limits=[pf.Rms("x1", density=1.0)])


def closed(length):
    N = np.array([[0, 1, 0], [0, -0.1, 0.1], [0, 0, 0]])
    F = expm(N * length)
    return F[:2, :2] + F[:2, 2:] @ LAW.K.reshape(1, 2)


def test_it_is_near_the_slowest_constant_period_and_no_more(analysed):
    rates = [
        -math.log(np.abs(np.linalg.eigvals(closed(time))).max()) / time
        for time in np.linspace(0.4, 0.6, 50)
    ]
    assert 0.9 * min(rates) < analysed.decay.level < min(rates)


def test_x_falls_so_for_periods_in_any_order(analysed):
    claim, rng = analysed.decay, np.random.default_rng(2)
    Q = np.array(claim.subject.evidence.X[0], dtype=float)
    for _ in range(500):
        x, time = rng.normal(size=2), rng.uniform(0.4, 0.6)
        y = closed(time) @ x
        assert y @ Q @ y < x @ Q @ x * math.exp(-2 * float(claim.level) * time)


def test_more_is_not_proved(analysed):
    assert prove(analysed.decay).proved
    assert not prove(replace(analysed.decay, level=analysed.decay.level * Fraction(11, 10))).proved


def test_check_reads_it_back_and_refuses_what_is_changed(analysed, tmp_path):
    analysed.save(tmp_path)
    document = json.loads((tmp_path / "design.json").read_text())
    assert check(from_plain(document)).proved
    file = from_plain(document)
    said = next(one for one in file.claims if one.kind == "decay").statement(file.plant)
    assert said.startswith("decay by exp(-0.42")
    assert "at samples, with inputs held for 400 to 600 ms in any order" in said
    claim = next(one for one in document["claims"] if one["kind"] == "decay")
    faults = [
        (claim, "level", "1/2"),
        (claim, "level", "1000000000"),
        (claim["held"]["clock"]["spans"][0], "most", "2"),
        (claim["held"]["vertices"][0]["A"][1], 1, 1),
        (claim["evidence"]["remainder"], "kappa", "1e-30"),
        (claim["evidence"]["Q"][0][0], 0, 0),
    ]
    for table, key, other in faults:
        known, table[key] = table[key], other
        assert not proved(document), key
        table[key] = known
    del claim["held"]["clock"]
    assert not proved(document)


def proved(document):
    """Whether a file is proved."""
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


@pytest.mark.parametrize("x", ["0", "1/1000", "3/7", "1", "25/2", "60"])
def test_a_power_is_rounded_down(x):
    found = power_below(Fraction(x))
    assert math.exp(-float(Fraction(x))) * (1 - 1e-12) < found
    assert found <= Fraction(math.exp(-float(Fraction(x)))) * (1 + Fraction(1, 10**14))
