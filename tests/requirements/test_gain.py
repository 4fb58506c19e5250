"""Gains of outputs that a disturbance passes straight into, against the frequency response."""

import numpy as np
import pytest

from polefence import FixedGain, InputError, UncertainPlant
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms
from polefence.search.optimise import optimise

SPEC = """
states = ["x [m]", "v [m/s]"]
inputs = ["pull [N]"]
disturbances = ["push [N]"]
[parameter.k]
range = [1, 3]
[matrices]
A = [[0, 1], ["-k", -0.4]]
B = [[0], [1]]
E = [[0], [1]]
[outputs]
"acceleration [m/s2]" = {C = ["-k", -0.4], D = [1], F = [1]}
"""
K = np.array([[-0.5, -0.8]])


def largest(k, C, D, F):
    """Of |F + (C + D K) (jw - A - B K)^-1 E| over frequency, at zero and infinity too."""
    A, B, E = np.array([[0, 1], [-k, -0.4]]), np.array([[0], [1]]), np.array([[0], [1]])
    w = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 20_000)])
    closed = A + B @ K
    G = np.linalg.solve(1j * w[:, None, None] * np.eye(2) - closed, E)
    return max(float(np.abs(F + (C + D * K) @ G).max()), abs(F))


def test_an_acceleration_is_bounded_as_its_frequency_response():
    plant = loads(SPEC)
    own = Gain("acceleration")
    true = max(largest(k, np.array([[-k, -0.4]]), 1.0, 1.0) for k in np.linspace(1, 3, 41))
    found = best_bound(plant, FixedGain(K), own)
    assert true * (1 - 1e-9) < found.level < true * 1.02
    assert found.claim.outputs[0].F
    seen = sampled(plant, FixedGain(K), own).worst
    assert seen == pytest.approx(true, rel=1e-3)
    assert own.unit(plant) == "m/s2 per N"


@pytest.mark.parametrize("F", [0.3, -2.0])
def test_a_bound_is_bracketed_at_one_vertex(F):
    A, B, E = [[0, 1], [-2, -0.4]], [[0], [1]], [[0], [1]]
    plant = UncertainPlant.from_vertices([A], [B], [E])
    output = Output("y", C=[1, 0.2], D=[0.1], F=[F])
    true, law = largest(2, np.array([[1, 0.2]]), 0.1, F), FixedGain(K)
    assert kept_bound(plant, law, Gain(output, 1.002 * true)) is not None
    assert kept_bound(plant, law, Gain(output, 0.999 * true)) is None


def test_a_law_is_found_for_such_an_output():
    plant = loads(SPEC)
    done = optimise(plant, Gain("acceleration"), [Gain("x", 2.0)], method="scheduled")
    assert done.bounds[0].level >= 1 - 1e-9  # what passes straight in, at high frequency
    assert done.bounds[0].level < best_bound(plant, FixedGain(K), Gain("acceleration")).level
    assert sampled(plant, done.law, Gain("acceleration")).worst <= done.bounds[0].level * 1.000001


def test_noise_that_passes_straight_in_has_no_rms():
    with pytest.raises(InputError, match="a disturbance passes straight into 'acceleration'"):
        optimise(loads(SPEC), Rms("acceleration"), method="scheduled")
