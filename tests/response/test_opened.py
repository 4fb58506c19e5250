"""Loops opened at one place, against plant and law written out as two systems of their own."""

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    Compensator,
    Disk,
    HalfPlane,
    InputError,
    Parameter,
    Structure,
    UncertainPlant,
    at_sample_time,
    observe,
    place,
    with_actuator,
    with_dead_time,
    with_sensor,
)
from polefence.examples import family
from polefence.law.laws import FixedGain
from polefence.response import Output, family_points, opened, places
from polefence.response.opened import Place

HERTZ = np.geomspace(0.02, 3.0, 40)
S = 2j * np.pi * HERTZ
A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.5, 1.0], [0.3, 0.0, -3.0]])
B = np.array([[0.0, 0.2], [1.0, 0.0], [0.4, 1.5]])


def plant(A=A, B=B, **more):
    return UncertainPlant.from_vertices([A], [B], **more)


def passes(A, B, C, s, D=0.0):
    """C (s - A)^-1 B + D, one frequency after the other."""
    return np.array([C @ np.linalg.solve(x * np.eye(len(A)) - A, B) + D for x in s])


def around(P, K, kind, k):
    """L of u = K y + d or y + d: one channel opened, the others closed, a frequency at a time."""
    found = []
    for G, F in zip(P, K, strict=True):
        # what comes back of a unit sent into channel k, the others fed back
        T = F @ G if kind == "input" else G @ F
        T = np.atleast_2d(T)
        others = np.diag(np.arange(len(T)) != k).astype(float)
        sent = np.eye(len(T))[k]
        found.append(-(T @ np.linalg.solve(np.eye(len(T)) - others @ T, sent))[k])
    return np.array(found)


def test_every_loop_of_a_gain_of_states():
    gain = np.array([[-1.0, -2.0, 0.5], [0.3, 0.1, -1.0]])
    P = passes(A, B, np.eye(3), S)
    K = np.broadcast_to(gain, (len(S), 2, 3))
    names = [(p.name, p.kind) for p in places(plant(), gain)]
    assert names == [("u1", "input"), ("u2", "input"), *((f"x{i}", "measured") for i in (1, 2, 3))]
    for k, (name, kind) in enumerate(names):
        loop = opened(plant(), gain, name)
        wanted = around(P, K, kind, k if kind == "input" else k - 2)
        np.testing.assert_allclose(loop.loop(HERTZ)[0], wanted, rtol=1e-10)
        np.testing.assert_allclose(loop.sensitivity(HERTZ)[0], 1 / (1 + wanted), rtol=1e-10)


def test_a_law_with_states_of_its_own_and_signals():
    own = [np.array(M) for M in ([[-4.0, 1.0], [0.0, -9.0]], [[1.0, 0.5], [0.0, 2.0]])]
    out = [np.array(M) for M in ([[1.0, -2.0], [0.5, 0.0]], [[-0.2, 0.1], [0.0, -0.4]])]
    law = Compensator(*own, *out, measured=("x1", "x3"))
    C = np.eye(3)[[0, 2]]
    P, K = passes(A, B, C, S), passes(own[0], own[1], out[0], S, out[1])
    known = places(plant(), law)
    assert [p.name for p in known] == ["u1", "u2", "x1", "x3"]
    for k, here in enumerate(known):
        wanted = around(P, K, here.kind, k % 2)
        np.testing.assert_allclose(
            opened(plant(), law, here.name).loop(HERTZ)[0], wanted, rtol=1e-9
        )


def test_a_pid_is_cut_before_its_integral_and_its_derivative():
    one = plant(B=B[:, :1])
    larger, structure = Structure(measured=("x1",), kind="pid", derivative_bandwidth=2.0).extended(
        one
    )
    kp, ki, kd, w = -2.0, -0.7, -0.4, 4 * np.pi
    law = structure.law(larger, [[[kp, ki, kd]]])
    G = passes(A, B[:, :1], np.eye(3)[:1], S)[:, 0, 0]
    wanted = -G * (kp + ki / S + kd * w * S / (S + w))
    assert [p.name for p in places(larger, law)] == ["u1", "x1"]
    for name in ("u1", "x1"):
        np.testing.assert_allclose(opened(larger, law, name).loop(HERTZ)[0], wanted, rtol=1e-9)


def test_what_a_law_takes_off_a_signal_is_its_own_input():
    C, D = np.array([[1.0, 0.5, 0.0]]), np.array([[0.4]])
    one = plant(B=B[:, :1], outputs=(Output("y", "m", C=C, D=D),))
    law = Compensator([[-3.0]], [[1.0]], [[2.0]], [[-0.6]], measured=("y",))
    G = passes(A, B[:, :1], C, S, D)[:, 0, 0]
    wanted = -G * (2 / (S + 3) - 0.6)
    assert places(one, law) == (Place("u1"), Place("y", "m", "measured"))
    for name in ("u1", "y"):
        np.testing.assert_allclose(opened(one, law, name).loop(HERTZ)[0], wanted, rtol=1e-9)


@pytest.mark.parametrize("delay", [1, 2])
def test_at_samples_the_law_remembers_its_own_demands(delay):
    T = 0.05
    held = at_sample_time(plant(), T, delay)
    both = expm(np.block([[A, B], [np.zeros((2, 5))]]) * T)
    Phi, Gamma = both[:3, :3], both[:3, 3:]
    random = np.random.default_rng(5)
    K = random.normal(size=(2, 3 + 2 * delay)) * 0.3
    z = np.exp(S * T)
    P = passes(Phi, Gamma, np.eye(3), z) * z[:, None, None] ** -delay
    feedback = []
    for x in z:  # u = K x + K_1 u / z + K_2 u / z^2
        own = sum(K[:, 3 + 2 * k : 5 + 2 * k] * x ** -(k + 1) for k in range(delay))
        feedback.append(np.linalg.solve(np.eye(2) - own, K[:, :3]))
    for k, name in enumerate(("u1", "u2")):
        loop = opened(held, K, name)
        assert loop.step == T
        np.testing.assert_allclose(loop.loop(HERTZ)[0], around(P, feedback, "input", k), rtol=1e-7)
    assert [p.name for p in places(held, K)] == ["u1", "u2", "x1", "x2", "x3"]
    for k in range(3):
        found = opened(held, K, f"x{k + 1}").loop(HERTZ)[0]
        np.testing.assert_allclose(found, around(P, feedback, "measured", k), rtol=1e-7)


def test_feedback_of_an_observer_in_continuous_and_in_discrete_time():
    servo = family("servo")
    for one, region, fast in (
        (servo, HalfPlane(2), HalfPlane(6)),
        (at_sample_time(servo, 0.02), None, None),
    ):
        if region is None:
            region, fast = Disk(0.3, 0.66), Disk(0.2, 0.6)
        observer = observe(one, ["motor angle", "load speed"], fast)
        law = observer.feedback(place(one, region))
        alpha = np.array([0.3, 0.7])
        Ac, Bc, Cc = law.compensator(alpha)
        A, B = one.at(alpha)
        s = S if one.sample_time is None else np.exp(S * float(one.sample_time))
        P, K = passes(A, B, observer.C[0], s), passes(Ac, Bc, Cc, s)
        known = places(one, law)
        names = [p.name for p in known]
        assert names == ["armature voltage", "motor angle", "load speed"]
        for k, here in enumerate(known):
            wanted = around(P, K, here.kind, max(k - 1, 0))
            found = opened(one, law, here.name, alpha).loop(HERTZ)[0]
            np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_scheduled_laws_and_functions_of_the_parameters_at_alpha():
    servo = family("servo")
    law = place(servo, HalfPlane(2))
    alpha = np.array([[0.2, 0.8], [1.0, 0.0]])
    L = opened(servo, law, alpha=alpha).loop(HERTZ)
    for found, a in zip(L, alpha, strict=True):
        A, B = servo.at(a)
        np.testing.assert_allclose(found, -passes(A, B, law.law.gain(a), S)[:, 0, 0], rtol=1e-8)
    curved = UncertainPlant.from_expressions(
        [Parameter("p", 1, 4)], [[0, 1], ["-sqrt(p)", "-exp(-p)"]], [[0], ["p*p"]]
    )
    K = [[-1.0, -0.5]]
    A, B = np.array([[0, 1], [-np.sqrt(2), -np.exp(-2)]]), np.array([[0.0], [4.0]])
    found = opened(curved, K, alpha=curved.alpha(p=2)).loop(HERTZ)[0]
    np.testing.assert_allclose(found, -passes(A, B, np.array(K), S)[:, 0, 0], rtol=1e-10)


def test_a_dead_time_turns_the_loop_by_its_phase():
    one = UncertainPlant.from_expressions([Parameter("k", 1, 3)], [[0, 1], ["-k", -1]], [[0], [1]])
    late = with_dead_time(one, "u1", 0.1)
    K = [[-1.0, -0.5, 0, 0, 0, 0]]
    alpha = family_points(late, 5)
    # the states alone: half of what they leave out on either side
    np.testing.assert_allclose(alpha[:, 0::2], alpha[:, 1::2])
    assert len(alpha) >= 5
    found = opened(late, K, alpha=alpha).loop(HERTZ)
    weights = np.stack([alpha[:, :2].sum(axis=1), alpha[:, 2:].sum(axis=1)], axis=1)
    plain = opened(one, [[-1.0, -0.5]], alpha=weights).loop(HERTZ)
    assert [p.name for p in places(late, K)] == ["u1", "x1", "x2"]
    np.testing.assert_allclose(found, plain * np.exp(-0.1 * S), rtol=1e-3)


def test_a_family_has_its_vertices_first_then_its_middle():
    car = family("quarter-car-physical")
    alpha = family_points(car, 30)
    N = len(car.vertices)
    np.testing.assert_array_equal(alpha[:N], np.eye(N))
    np.testing.assert_array_equal(alpha[N], np.full(N, 1 / N))
    assert len(alpha) == N + 1 + 30
    law = FixedGain(np.zeros((1, 5)))
    assert len(opened(car, law).alpha) > 100


def test_signals_with_hardware_answer_to_their_own_names():
    larger = with_sensor(with_actuator(family("servo"), "armature voltage", 80), "motor angle", 50)
    law = Compensator(D=[[-2.0]], measured=("measured motor angle",))
    for name, known in (
        ("armature voltage", "demand of armature voltage"),
        ("motor angle [rad]", "measured motor angle"),
        ("measured motor angle", "measured motor angle"),
    ):
        assert opened(larger, law, name).place.name == known


@pytest.mark.parametrize("name", ["u3", "y", ""])
def test_a_loop_that_is_not_there_is_named(name):
    with pytest.raises(InputError, match="no loop"):
        opened(plant(), np.zeros((2, 3)), name)


def test_a_loop_that_is_not_well_posed_is_refused():
    one = plant(B=B[:, :1], outputs=(Output("y", C=[1, 0, 0], D=[0.5]),))
    # of what is left of y the law is 2 y0 = 2 (y - u / 2): of y itself it has no finite gain
    law = Compensator(D=[[-2.0]], measured=("y without inputs",))
    with pytest.raises(InputError, match="not well-posed"):
        opened(one, law, "y")
