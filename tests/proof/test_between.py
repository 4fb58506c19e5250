"""Between samples: bounds of means over a period, against quadrature and simulated drives."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm, solve_discrete_lyapunov

import polefence as pf
from polefence.certify.bounds import best_bound, each_at_samples, each_sampled, kept_bound
from polefence.plant.spec import loads
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError, counted
from support.periods import T, by_quadrature, some_period
from support.specs import SPRING

LAW = {0: np.array([[-30.0, -12.0]]), 1: np.array([[-30.0, -12.0, -0.2]])}


def valued(P, at):
    """A polynomial's value at a point of its box."""
    simplices = [(1 - Fraction(t), Fraction(t)) for t in at] or [(Fraction(1),)]
    weights = [x for pair in simplices for x in pair]
    total = np.zeros(P.shape)
    for e, M in P.terms.items():
        times = np.prod([float(w) ** k for w, k in zip(weights, e, strict=True)])
        total += times * np.array([[float(Fraction(x, P.whole)) for x in row] for row in M])
    return total


def excess(mean, period, low, high, at):
    """Least eigenvalues of what the bounds are above the truth, and how much, in units."""
    inner = [Fraction(a) + (Fraction(b) - a) * t for a, b, t in zip(low, high, at, strict=True)]
    truth = by_quadrature(period, list(map(float, inner)))
    units = np.array(period.units, dtype=float)
    scales = (units, 1 / units[: period.n], np.ones(1))
    least, most = [], []
    for P, true, scale in zip((mean.M, mean.V, mean.c), truth, scales, strict=True):
        found = valued(P, at)
        size = np.abs(np.atleast_2d(true) * scale * scale[:, None]).max()
        values = np.linalg.eigvalsh((found - true) * scale * scale[:, None] / size)
        least.append(values[0])
        most.append(values[-1])
    return min(least), max(most)


@pytest.mark.parametrize("share", [None, Fraction(1, 3), Fraction(9, 10)])
@pytest.mark.parametrize("parameters", [0, 1, 2])
def test_means_are_never_below_those_of_quadrature(parameters, share):
    rng = np.random.default_rng(parameters)
    sizes = (2,) * parameters or (1,)
    for _ in range(1 if share else 3):
        period = some_period(rng, parameters, share=share)
        gaps = []
        for width in (Fraction(1, 2), Fraction(1, 4)):
            low = tuple(Fraction(1, 4) for _ in range(parameters))
            high = tuple(x + width for x in low)
            with counted(10**12):
                mean = period.on_part(low, high, sizes)
            found = [
                excess(mean, period, low, high, list(map(Fraction, at)))
                for at in rng.uniform(0, 1, (6, parameters))
            ]
            assert min(least for least, _ in found) > -1e-11
            gaps.append(max(most for _, most in found))
        if parameters:  # falls as the third power of the width
            assert gaps[1] < gaps[0] / 6
        else:
            assert gaps[0] < 1e-11


def test_a_period_that_is_too_long_is_refused():
    period = replace(some_period(np.random.default_rng(4), 1), step=Fraction(10**9))
    with counted(10**12), pytest.raises(FormatError, match="the sample time is too long"):
        period.require_moderate()


@pytest.fixture(scope="module")
def spring():
    return loads(SPRING)


def sampled_and_loop(plant, law, T, at, delay=0):
    """Covariances of a loop at a point, by another way: moments over fine steps of a period."""
    point = np.atleast_2d(at)
    A, B = (M[0] for M in plant.at(point))
    E, n = plant.driven(point)[0], plant.shape[0]
    K, steps = law, 400
    late = round(delay * steps)  # steps after a sample, from which on its input acts
    h = float(T) / steps
    # x, the input that acts, and the one that follows it
    step = np.eye(n + 2)
    step[: n + 1, : n + 1] = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * h)
    change = np.eye(n + 2)
    change[n] = np.eye(n + 2)[n + 1]
    F = expm(A * h)
    W = quad_vec(lambda s: expm(A * s) @ E @ E.T @ expm(A * s).T, 0, h, epsrel=1e-12)[0] / 2
    moved, added = [np.eye(n + 2) if late else change], [np.zeros((n, n))]
    for k in range(1, steps + 1):
        now = step @ moved[-1]
        moved.append(change @ now if k == late < steps else now)
        added.append(F @ added[-1] @ F.T + W)
    # the law's input of a sample is what acts last: before a change it is the one that follows
    gain = np.zeros((1, n + 1))
    gain[0, : K.shape[1]] = K
    up = np.vstack([np.eye(n + 1), gain])
    closed = np.vstack([moved[-1][:n], np.eye(n + 2)[n + 1]]) @ up
    noise = np.zeros((n + 1, n + 1))
    noise[:n, :n] = added[-1]
    P = up @ solve_discrete_lyapunov(closed, noise) @ up.T
    position = [(M @ P @ M.T)[0, 0] + X[0, 0] for M, X in zip(moved, added, strict=True)]
    return np.sqrt(np.trapezoid(position) / steps), np.sqrt(P[0, 0])


@pytest.mark.parametrize("delay", [0, Fraction(1, 4), 0.7, 1])
def test_a_bound_is_at_all_times_and_close(spring, delay):
    seen = pf.at_sample_time(spring, T, delay)
    asked, gain = pf.Rms("x", density=1.0), LAW[1 if delay else 0]
    bound = best_bound(seen, pf.FixedGain(gain), asked)
    assert bound is not None
    corners = np.eye(len(seen.vertices))
    found = [sampled_and_loop(spring, gain, T, at, delay)[0] for at in corners]
    computed = asked.values(seen, pf.FixedGain(gain), corners)
    assert computed == pytest.approx(found, rel=1e-5)
    assert bound.level >= max(found) * (1 - 1e-9)
    assert bound.level <= max(found) * 1.01
    law, below = pf.FixedGain(gain), max(found) * (1 - 1e-3)
    assert kept_bound(seen, law, replace(asked, at_most=below)) is None


@pytest.mark.parametrize("clock", ["perfect", "jitter 20 %"])
def test_signals_of_one_noise_share_what_they_can(spring, clock):
    """Each as if it were alone: of all states, of one, behind filters, under another noise."""
    jitter = {} if clock == "perfect" else {"jitter": Fraction(1, 5)}
    seen, law = pf.at_sample_time(spring, T, 1, **jitter), pf.FixedGain(LAW[1])
    alpha = np.vstack([np.eye(len(seen.vertices)), np.full(len(seen.vertices), 0.25)[None]])
    signals = [pf.Rms("x", density=1.0), pf.Rms("v", density=1.0), pf.Rms("f", density=1.0)]
    signals += [pf.Rms("x", density=2.0), pf.EnergyPeak("x", norm=1.0)]
    found = each_sampled(seen, law, signals, alpha)
    for one, together in zip(signals, found, strict=True):
        assert together.values == pytest.approx(one.values(seen, law, alpha), rel=1e-9)
    for one, values in zip(signals, each_at_samples(seen, law, signals, alpha), strict=True):
        alone = one.at_samples(seen, law, alpha)
        assert (values is None) == (alone is None)
        assert alone is None or values == pytest.approx(alone, rel=1e-9)
    assert found[3].values == pytest.approx(2**0.5 * found[0].values, rel=1e-9)


def test_as_the_sample_time_falls_it_is_that_of_continuous_time(spring):
    asked, corners = pf.Rms("x", density=1.0), np.eye(len(spring.vertices))
    law = pf.FixedGain(LAW[0])
    known = asked.values(spring, law, corners)
    apart = [
        np.abs(asked.values(pf.at_sample_time(spring, h, 0), law, corners) / known - 1).max()
        for h in (4e-3, 2e-3, 1e-3)
    ]
    assert apart[0] > apart[1] > apart[2]
    assert apart[2] < 0.02


def test_no_drive_has_more(spring):
    """A drive in fine steps, noise in each: the mean over many of them keeps its bound."""
    seen = pf.at_sample_time(spring, T, 1)
    bound = best_bound(seen, pf.FixedGain(LAW[1]), pf.Rms("x", density=1.0))
    rng, steps, drives = np.random.default_rng(5), 20, 1000
    for vertex in spring.vertices:
        n, h = 2, float(T) / steps
        F = expm(np.block([[vertex.A, vertex.B], [np.zeros((1, 3))]]) * h)
        root = np.linalg.cholesky(
            quad_vec(
                lambda s, A=vertex.A, E=vertex.E: expm(A * s) @ E @ E.T @ expm(A * s).T / 2, 0, h
            )[0]
            + 1e-18 * np.eye(2)
        )
        x, acting, total = np.zeros((n, drives)), np.zeros(drives), 0.0
        for k in range(400):
            sent = LAW[1][0] @ np.vstack([x, acting])
            for _ in range(steps):
                x = F[:2] @ np.vstack([x, acting]) + root @ rng.normal(size=(2, drives))
                total += (x[0] ** 2).mean() if k >= 100 else 0.0
            acting = sent
        assert (total / (300 * steps)) ** 0.5 < bound.level * 1.01  # 1,000 drives are off by 1/300


def is_proved(document):
    """Whether a file of a design is proved."""
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


def broken(rows):
    """One fault at a time in what is held."""
    rows["delay"] += 1
    yield
    rows["delay"] -= 1
    known = rows.get("early", 0)
    rows["early"] = "1/3"
    yield
    rows["early"] = known
    for key, i, j in (("A", 1, 0), ("B", 1, 0), ("E", 1, 0)):
        known = rows["vertices"][0][key][i][j]
        rows["vertices"][0][key][i][j] = "1" if known != "1" else "2"
        yield
        rows["vertices"][0][key][i][j] = known


@pytest.mark.parametrize("delay", [1, 0.5])
def test_what_is_held_is_what_the_samples_are_of(spring, tmp_path, delay):
    seen = pf.at_sample_time(spring, T, delay)
    asked = pf.Rms("x", density=1.0)
    pf.optimise(seen, asked, [pf.Rms("f", density=1.0, at_most=3.0)]).save(tmp_path)
    document = json.loads((tmp_path / "design.json").read_text())
    assert is_proved(document)
    claims = [claim for claim in document["claims"] if claim["kind"] == "rms" and "held" in claim]
    assert len(claims) == 2
    for _ in broken(claims[0]["held"]):
        assert not is_proved(document)
    assert is_proved(document)
    level = claims[0]["level"]
    claims[0]["level"] = float(Fraction(str(level))) * 0.99
    assert not is_proved(document)
    claims[0]["level"] = level
    samples = next(claim for claim in document["claims"] if claim["kind"] == "samples")
    document["claims"].remove(samples)
    assert not is_proved(document)


def step_at(period, at, theta):
    """What a period makes of x at a point, by another exponential."""
    weights = np.array([1.0])
    for t in at:
        weights = np.kron(weights, [1 - t, t])
    moved, signals = np.eye(4), [period.B] + ([period.changed.B] if period.changed else [])
    for time, B in zip(period.times(theta), signals, strict=True):
        N = np.zeros((4, 4))
        N[:3] = np.tensordot(weights, np.concatenate([period.A, B], axis=2).astype(float), 1)
        moved = expm(N * time * float(T)) @ moved
    return ((moved - np.eye(4)) / float(T))[:3]


def lasting(period, theta):
    """The same period, all of whose lengths are one."""
    changed, theta = period.changed, Fraction(theta)
    if changed is not None:
        changed = replace(changed, share=1 - (1 - changed.share) / theta)
    return replace(period, lengths=None, step=theta * T, changed=changed)


@pytest.mark.parametrize("share", [None, Fraction(1, 3), Fraction(4, 5)])
@pytest.mark.parametrize("parameters", [0, 1])
def test_periods_of_any_length_are_within_what_their_step_may_miss(parameters, share):
    rng = np.random.default_rng(7 + parameters)
    family, sizes = some_period(rng, parameters, share=share), (2,) * (parameters + 1)
    largest = list[float]()
    for lengths in ((Fraction(3, 4), Fraction(7, 4)), (Fraction(5, 4), Fraction(7, 4))):
        period, width = family.between(lengths), lengths[1] - lengths[0]
        low, high = (Fraction(1, 4),) * parameters, (Fraction(1, 4) + width / 4,) * parameters
        with counted(10**12):
            step = period.step_on(low, high, sizes)
        off = np.array([[float(x) for x in row] for row in step.off])
        largest.append(off.max())
        for at in rng.uniform(0, 1, (8, parameters + 1)):
            inner = [float(a) + float(b - a) * t for a, b, t in zip(low, high, at, strict=False)]
            theta = float(lengths[0] + width * Fraction(at[-1]))
            assert valued(step.theta, at)[0, 0] == pytest.approx(theta)
            moved = step_at(period, inner, theta)
            missed = np.abs(valued(step.moved, at) - moved)
            assert np.all(missed <= off * (1 + 1e-9) + 1e-12 * np.abs(moved).max())
            M, V, c = by_quadrature(lasting(period, theta), inner)
            for P, true in zip((step.whole.M, step.whole.V, step.whole.c), (M, V, c), strict=True):
                true = theta * true
                more = valued(P, at) - np.atleast_2d(true)
                assert np.linalg.eigvalsh(more).min() > -1e-11 * np.abs(true).max()
    assert largest[1] < largest[0] / 6


def test_a_file_without_noise_is_read(spring, tmp_path):
    """Its rms is zero, and so is less than any level."""
    seen = pf.at_sample_time(spring, T, 1)
    pf.optimise(seen, pf.Rms("x", density=1.0), [pf.Rms("f", density=1.0, at_most=3.0)]).save(
        tmp_path
    )
    document = json.loads((tmp_path / "design.json").read_text())
    for claim in document["claims"]:
        if "held" in claim:
            claim["intensity"] = 0
    assert is_proved(document)
