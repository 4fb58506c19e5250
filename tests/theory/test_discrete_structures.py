"""Laws with states of their own in discrete time: searched, proved, and run as code."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polefence import (
    Disk,
    HalfPlane,
    InputError,
    Structure,
    UncertainPlant,
    at_sample_time,
    optimise,
    place,
    tightest,
)
from polefence.cli.main import main
from polefence.export import check_guarantee, export_c99
from polefence.plant.delta import delta_form
from polefence.plant.larger import own_states, with_actuator, with_pid, with_sensor, with_states
from polefence.plant.outputs import Output
from polefence.plant.samples import claim_of_samples
from polefence.plant.spec import dumps, load, loads
from polefence.proof.claims.base import prove
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.work import FormatError
from support.cortex import HOST_TOOLS, missing_tools
from support.memories import Code
from support.needed import require
from support.specs import TWO_STATES, rms

T = Fraction(1, 20)
FIRST = Structure(("x",), (), order=1, largest_gain=2.0)


def sampled(time=T, delay=0):
    return at_sample_time(loads(TWO_STATES), time, delay).combinations


def random_plant(seed, n=4, time=T):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(n, n)), random.normal(size=(n, 2))
    return UncertainPlant.from_vertices([A], [B], sample_time=time)


@given(st.integers(0, 100), st.integers(1, 4))
@settings(max_examples=20, deadline=None)
def test_a_law_is_that_of_python_control_in_its_delta_form(seed, order):
    plant, random = random_plant(seed), np.random.default_rng(seed)
    own, C, time = plant.vertices[0], random.normal(size=(2, 4)), float(T)
    shapes = (order, order), (order, 2), (2, order), (2, 2)
    a, b, c, d = (random.normal(size=shape) for shape in shapes)
    law = control.ss(np.eye(order) + time * a, time * b, c, d, time)
    loop = control.feedback(control.ss(own.A, own.B, C, np.zeros((2, 2)), time), law, sign=1)
    larger = with_states(plant, order)
    seen = np.zeros((2 + order, 4 + order))
    seen[:2, :4], seen[2:, 4:] = C, np.eye(order)
    found = larger.A[0] + larger.B[0] @ np.block([[d, c], [b, a]]) @ seen
    assert np.allclose(np.poly(found), np.poly(loop.poles()), rtol=1e-8, atol=1e-8)


def test_its_states_are_told_by_their_matrices_and_the_delta_form_is_that_of_continuous_time():
    larger = with_states(sampled(), 2)
    assert own_states(larger) == 2
    delta = delta_form(larger)
    assert own_states(delta) == 2
    assert (
        delta.vertices[0].exact_B[2:] == with_states(loads(TWO_STATES), 2).vertices[0].exact_B[2:]
    )
    assert own_states(replace(larger, sample_time=2 * T)) == 0
    assert own_states(replace(larger, sample_time=None)) == 0


def test_a_pid_sums_its_signal_and_takes_the_slope_of_a_ramp():
    plant = replace(random_plant(3), outputs=(Output("y", "m", C=[1, 2, 3, 4]),))
    larger, names = with_pid(plant, plant.outputs, 2)
    assert names == ("y", "pid integral of y", "pid derivative of y")
    A, C = larger.A[0][4:], np.array([float(x) for x in larger.signal(names[2]).C[0]])
    slope, x, total = 0.7, np.array([1.0, 0, 0, 0]), 0.0
    state = np.zeros(2)
    for k in range(400):
        y = slope * k * float(T)
        whole = np.concatenate([y * x, state])
        rate = C @ whole
        assert state[0] == pytest.approx(total, abs=1e-12)
        total += float(T) * y
        state = A @ whole
    assert rate == pytest.approx(slope, rel=1e-9)
    # the filter is that of a signal held: it keeps exp(-w T) of itself
    assert A[1, 5] == pytest.approx(math.exp(-4 * math.pi * float(T)), rel=1e-11)


@cache
def optimised():
    return optimise(sampled(), rms("x"), (), HalfPlane(0.1), structure=FIRST)


def test_an_optimised_law_keeps_what_is_proved():
    done = optimised()
    plain = optimise(sampled(), rms("x"), structure=replace(FIRST, order=0))
    assert done.bounds[0].level < 0.95 * plain.bounds[0].level
    worst = 0.0
    for m in np.linspace(0.8, 1.25, 9):
        for k in np.linspace(1, 3, 9):
            alpha = done.plant.alpha(m=m, k=k)
            A, B = done.plant.at(alpha)
            E = np.tensordot(alpha, np.array([v.E for v in done.plant.vertices]), 1)
            F = A + B @ done.law.gain(alpha)
            assert np.abs(np.linalg.eigvals(F)).max() < math.exp(-0.1 * float(T))
            X = control.dlyap(F, E @ E.T / float(T))  # noise of intensity 1, held
            worst = max(worst, math.sqrt(X[0, 0]))
    assert 0.99 * done.bounds[0].level < worst <= done.bounds[0].level


def test_as_the_sample_time_falls_it_is_the_law_of_continuous_time():
    near = optimise(sampled(Fraction(1, 200)), rms("x"), (), HalfPlane(0.1), structure=FIRST)
    continuous = optimise(loads(TWO_STATES), rms("x"), (), HalfPlane(0.1), structure=FIRST)
    for own, share in ((optimised(), 0.02), (near, 0.003)):
        assert own.bounds[0].level == pytest.approx(continuous.bounds[0].level, rel=share)


@pytest.mark.parametrize("pid", [False, True])
def test_regions_are_kept_by_laws_that_are_placed(tmp_path, pid):
    own = Structure(("x",), kind="pid", derivative_bandwidth=1) if pid else FIRST
    design = place(sampled(), HalfPlane(0.05), structure=own)
    for m, k in ((0.8, 1), (1.25, 3), (1.0, 2.0)):
        alpha = design.plant.alpha(m=m, k=k)
        A, B = design.plant.at(alpha)
        poles = np.linalg.eigvals(A + B @ design.law.gain(alpha))
        assert np.abs(poles).max() < math.exp(-0.05 * float(T))
    design.save(tmp_path)
    assert check(read((tmp_path / "design.json").read_text())).proved


def test_the_smallest_disk_is_smaller_with_a_state():
    text = TWO_STATES.replace("[parameter.k]\nrange = [1, 3]", "[constants]\nk = 2")
    plant = at_sample_time(loads(text), T).combinations
    free = replace(FIRST, largest_gain=None)
    with_state = tightest(plant, 0, structure=free).region.radius
    without = tightest(plant, 0, structure=replace(free, order=0)).region.radius
    assert with_state < 0.9 * without


@pytest.mark.usefixtures("hasty")
def test_a_remainder_is_covered_with_the_laws_states(tmp_path):
    """What a computer sees, one sample late: the law's states are its own, and exact."""
    path = tmp_path / "spec.toml"
    path.write_text(TWO_STATES)
    options = [
        "--measured",
        "x",
        "--schedule",
        "none",
        "--order",
        "1",
        "--region",
        "half_plane(0.05)",
    ]
    out = tmp_path / "out"
    assert (
        main(
            ["design", str(path), *options, "--sample-time", "0.05", "--delay", "1", "-o", str(out)]
        )
        == 0
    )
    assert main(["check", str(out), "--spec", str(path)]) == 0
    design = place(
        at_sample_time(load(path), T, 1),
        HalfPlane(0.05),
        structure=replace(FIRST, largest_gain=None),
    )
    entries = design.plant.remainder.entries
    assert not any(entries[3])
    assert not any(row[3] or row[5] for row in entries)
    claim = claim_of_samples(design.plant)
    assert prove(claim).proved
    assert "(states 1 to 3)" in claim.statement(claim.plant)
    for column in ("B", "A"):  # the law's rate, or its state, moves the plant behind the law's back
        M = [[list(row) for row in each] for each in getattr(claim.plant, column)]
        M[1][0][-1] += Fraction(1, 10**12)
        assert not prove(replace(claim, plant=replace(claim.plant, **{column: M}))).proved


@pytest.mark.parametrize("bits", [32, 64])
def test_its_code_takes_the_steps_that_are_proved(tmp_path, bits):
    require(missing_tools(HOST_TOOLS))
    made = export_c99(optimised().design, bits)
    code, law = Code(made, tmp_path), made.design.law
    assert made.guarantee.share < 0.1
    assert check_guarantee(tmp_path).proved
    K, C = law.gain(np.eye(4)[:1])[0], np.eye(3)
    x, z = np.array([0.3, 0.0]), 0.0
    code.reset()
    for _ in range(200):
        K_x = K @ C @ [*x, z]
        u, flags = code.update(None, [x[0]])
        assert flags == 0
        size = 1e-5 if bits == 32 else 1e-12
        assert u[0] == pytest.approx(K_x[0], abs=size)
        z += float(T) * K_x[1]
        assert code.states[0] == pytest.approx(z, abs=20 * size)
        z = code.states[0]
        x = made.design.plant.A[0][:2, :2] @ x + made.design.plant.B[0][:2, 0] * u[0]


def in_memory(claim, **changes):
    return replace(claim, code=replace(claim.code, memory=replace(claim.code.memory, **changes)))


def with_matrix(claim, letter, i, j, value):
    own = claim.gain.subject.design
    matrices = [[list(row) for row in M] for M in getattr(own, letter)]
    matrices[2][i][j] += value
    subject = replace(claim.gain.subject, design=replace(own, **{letter: matrices}))
    return replace(claim, gain=replace(claim.gain, subject=subject))


WRONG = {
    "of continuous time": lambda c: in_memory(c, discrete=False),
    "of another time": lambda c: in_memory(c, sample_time=2 * T),
    "does not stay": lambda c: with_matrix(c, "A", 2, 2, Fraction(-1, 10**6)),
    "moves the plant": lambda c: with_matrix(c, "A", 1, 2, Fraction(1, 10**6)),
    "moved by the plant": lambda c: with_matrix(c, "A", 2, 1, Fraction(1, 10**6)),
    "another rate": lambda c: with_matrix(c, "B", 2, 1, Fraction(1, 10**6)),
    "moved by the input": lambda c: with_matrix(c, "B", 2, 0, Fraction(1, 10**6)),
}


@pytest.mark.parametrize("what", WRONG)
def test_states_that_are_not_the_codes_own_are_refused(what):
    claim = export_c99(optimised().design, 64).guarantee.claim
    assert prove(claim).proved
    with pytest.raises(FormatError, match=r"code\.memory"):
        prove(WRONG[what](claim))


def test_a_file_with_another_sample_time_is_refused(tmp_path):
    export_c99(optimised().design, 64).save(tmp_path)
    text = (tmp_path / "guarantee.json").read_text()
    assert text.count('"sample_time": "1/20"') == 2
    with pytest.raises(FormatError, match=r"memory\.sample_time must be the plant's"):
        read('"sample_time": "1/10"'.join(text.rsplit('"sample_time": "1/20"', 1)))


REFUSED = {
    "a fast filter": (
        lambda: with_pid(sampled(), [sampled().signal("x")], 11),
        "bandwidth = 11 is above half the samples' frequency, 10 Hz",
    ),
    "an actuator": (lambda: with_actuator(sampled(), "force", 3), "are of continuous time"),
    "a sensor": (lambda: with_sensor(sampled(), "x", 3), "are of continuous time"),
    "its delta form": (lambda: with_sensor(delta_form(sampled()), "x", 3), "of continuous time"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_of_continuous_time_is_refused(what):
    make, said = REFUSED[what]
    with pytest.raises(InputError, match=said) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_spec_in_discrete_time_has_a_law(tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(dumps(sampled()) + '[law]\nmeasured = ["x"]\nschedule = []\norder = 1\n')
    out = tmp_path / "out"
    assert main(["design", str(path), "--region", "disk(0, 0.999)", "-o", str(out)]) == 0
    assert main(["check", str(out), "--spec", str(path)]) == 0
    assert Disk(0, 0.999).contains(np.linalg.eigvals(sampled().A).ravel())
