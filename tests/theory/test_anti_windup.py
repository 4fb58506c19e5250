"""Anti-windup of laws with states of their own: exact limits, trajectories, faults in files."""

import json

import numpy as np
import pytest

from polefence import (
    Design,
    FixedGain,
    HalfPlane,
    PolynomialGain,
    Rms,
    Saturation,
    Structure,
    UncertainPlant,
    at_sample_time,
    optimise,
)
from polefence.base.errors import InputError
from polefence.certify.anti_windup import with_anti_windup
from polefence.certify.bounds import best_bound, save
from polefence.plant.delta import delta_form
from polefence.plant.exact import file_plant
from polefence.plant.larger import with_states
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import prove
from polefence.proof.document import Document, check, loads
from polefence.proof.work import FormatError

# x' = a x + b u is held from 1 by no limit below a / b; the law is u = -4 x - 3 z, z' = x.
LEAST = 1.2 / 0.9
START = Saturation("u", points=[(1.0, 0.0)])


def unstable():
    parameters = [Parameter("a", 0.8, 1.2), Parameter("b", 0.9, 1.1)]
    return UncertainPlant.from_function(
        lambda a, b: ([[a]], [[b]], [[b]]),
        parameters,
        states=("x",),
        inputs=("u",),
        disturbances=("w",),
        name="unstable",
    )


def integrating(plant, gain=None):
    """Proportional and integral action, of the inputs on their way no part."""
    n = plant.shape[0]
    K = np.zeros((2, n))
    K[0, [0, -1]], K[1, 0] = (-4.0, -3.0), 1.0
    law = PolynomialGain(((0, 0),), [K], (), plant.parameters)
    if gain is None:
        return law
    G = np.zeros((n, 2))
    G[-1, 0] = gain
    return law.with_anti_windup(G)


def ends(gain, U, a=1.2, b=0.9, T=20.0, dt=0.001):
    """The size of the state at last, written out by hand: nothing of the package is used."""
    x, z = 1.0, 0.0
    for _ in range(int(T / dt)):
        u = -4 * x - 3 * z
        acts = min(max(u, -U), U)
        x, z = x + dt * (a * x + b * acts), z + dt * (x + gain * (acts - u))
        if abs(x) > 1e3:
            break
    return abs(x)


def document(bound, plant):
    law = bound.claim.subject.law
    return Document(file_plant(plant), law, (bound.claim,), bound.claim.subject.on)


def test_anti_windup_recovers_from_all_that_any_law_recovers_from():
    plant = with_states(unstable(), 1)
    without, with_it = (best_bound(plant, integrating(plant, g), START) for g in (None, -0.4))
    assert without.level > 1.25 * LEAST
    assert LEAST < with_it.level < 1.005 * LEAST
    # between the two limits the motion decays with it, and is lost without it
    between = 1.01 * with_it.level
    assert ends(-0.4, between) < 1e-2 < 1e2 < ends(0.0, between)
    assert ends(-0.4, 0.99 * LEAST) > 1e2
    simulated = START.values(plant, integrating(plant, -0.4), np.eye(4)).max()
    assert 0.95 * LEAST < simulated < with_it.level


@pytest.mark.parametrize("delay", [0, 1])
def test_it_is_proved_at_samples_too(delay):
    samples = with_states(at_sample_time(unstable(), 0.05, delay), 1)
    start = Saturation("u", points=[(1.0,) + (0.0,) * (samples.shape[0] - 1)])
    without, with_it = (
        best_bound(delta_form(samples), integrating(samples, g), start) for g in (None, -0.4)
    )
    assert with_it.level < 0.8 * without.level
    simulated = start.values(samples, integrating(samples, -0.4), np.eye(4)).max()
    assert 0.97 * with_it.level < simulated < with_it.level


def test_it_is_read_back_from_a_file_and_proved_from_that_alone():
    plant = with_states(unstable(), 1)
    whole = document(best_bound(plant, integrating(plant, -0.4), START), plant)
    again = loads(whole.dumps())
    assert again == whole
    assert check(again).proved
    (said,) = check(again).claims
    assert "saturated at +-1.33" in said
    assert "-0.4 (sat(u1) - u1) added to the rate of x2" in said.replace("~", "")


@pytest.mark.parametrize("gain", [0.0, -0.2, -0.45, 0.4])
def test_another_gain_in_the_file_is_refused(gain):
    plant = with_states(unstable(), 1)
    table = json.loads(document(best_bound(plant, integrating(plant, -0.4), START), plant).dumps())
    table["law"]["anti_windup"][1][0] = gain
    assert not check(loads(json.dumps(table))).proved


def test_it_may_be_left_out_of_a_file_only_where_it_is_zero():
    plant = with_states(unstable(), 1)
    for gain, proved in ((0.0, True), (-0.4, False)):
        bound = best_bound(plant, integrating(plant, gain), START)
        table = json.loads(document(bound, plant).dumps())
        del table["law"]["anti_windup"]
        assert check(loads(json.dumps(table))).proved is proved


def test_it_acts_on_states_of_the_law_alone():
    plant = with_states(unstable(), 1)
    table = json.loads(document(best_bound(plant, integrating(plant, -0.4), START), plant).dumps())
    for faulty, reason in (
        ([[0.1, 0], [-0.4, 0]], "row 1 is of"),
        ([[0], [-0.4]], "anti_windup"),
        ([[0, 0]], "anti_windup"),
    ):
        table["law"]["anti_windup"] = faulty
        with pytest.raises(FormatError, match=reason):
            loads(json.dumps(table))
    table["law"]["anti_windup"] = [[0, 0], [-0.4, 0]]
    for vertex in table["plant"]["vertices"]:
        vertex["E"][1] = [1]
    with pytest.raises(FormatError, match="a disturbance acts on"):
        loads(json.dumps(table))


def test_it_has_a_row_a_state_and_a_column_an_input():
    plant = with_states(unstable(), 1)
    with pytest.raises(InputError, match="anti_windup must be 2 x 2"):
        integrating(plant).with_anti_windup(np.zeros((1, 2)))


def test_a_bound_is_not_that_of_another_limit():
    plant = with_states(unstable(), 1)
    bound = best_bound(plant, integrating(plant, -0.4), START)
    table = json.loads(document(bound, plant).dumps())
    assert all(prove(claim).proved for claim in loads(json.dumps(table)).claims)
    table["claims"][0]["level"] = 0.999 * LEAST
    assert not check(loads(json.dumps(table))).proved


# --- the gain that is found -----------------------------------------------------------------------


def test_the_gain_that_is_found_is_the_best_there_is():
    plant = with_states(unstable(), 1)
    law = with_anti_windup(plant, integrating(plant), [START])
    assert LEAST < best_bound(plant, law, START).level < 1.0005 * LEAST
    assert not np.any(np.delete(law.anti_windup.ravel(), 2))


@pytest.mark.parametrize(
    "asked", [Saturation("u", norm=0.5), Saturation("u", ellipsoid=((1.0, 0), (0, 0.1)))]
)
def test_it_is_found_for_every_kind_of_start(asked):
    plant = with_states(unstable(), 1)
    found = with_anti_windup(plant, integrating(plant), [asked])
    without, with_it = (best_bound(plant, law, asked) for law in (integrating(plant), found))
    assert with_it.level < 0.96 * without.level
    for times in (0.3, 3.0):  # no other is better
        other = found.with_anti_windup(times * found.anti_windup)
        assert best_bound(plant, other, asked).level > 0.9999 * with_it.level


def test_a_pid_has_one_and_laws_without_states_have_none():
    static = FixedGain(np.array([[-4.0]]))
    assert with_anti_windup(unstable(), static, [Saturation("u", points=[(1.0,)])]) is static
    structure = Structure(measured=("x",), schedule=(), kind="pid", derivative_bandwidth=5.0)
    plant, gain = structure.extended(unstable())
    law = gain.law(plant, np.array([[[-6.0, -6.0, -0.1]]]))
    asked = Saturation("u", norm=0.5)
    assert with_anti_windup(plant, law, []) is law
    found = with_anti_windup(plant, law, [asked])
    levels = [best_bound(plant, choice, asked).level for choice in (law, found)]
    assert levels[1] < 0.95 * levels[0]
    assert not np.any(found.anti_windup[0])  # the plant's own state


def test_optimise_finds_it_unasked_and_its_file_says_so(tmp_path):
    structure = Structure(
        measured=("x",),
        schedule=(),
        kind="pid",
        derivative_bandwidth=5.0,
        pattern=(("p", "i", "0"),),
        largest_gain=6.0,
    )
    limits = (Saturation("u", points=[(1.0,)], at_most=1.45),)
    done = optimise(unstable(), Rms("x"), limits, region=HalfPlane(1.0), structure=structure)
    law = done.design.law
    assert np.any(law.anti_windup)
    asked = done.bounds[1].specification
    assert best_bound(done.design.plant, law.with_anti_windup(None), asked).level > 1.45
    path = save(done.design.certificate, [bound.claim for bound in done.bounds], tmp_path)
    assert check(loads(path.read_text())).proved
    again = Design.load(path)
    assert np.array_equal(again.law.anti_windup, law.anti_windup)
    assert "G (sat(u) - u)" in "; ".join(law.definitions)
    assert law.named_gains()["G"].shape[1] == 1
