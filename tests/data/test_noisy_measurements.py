"""Fits to noise: slopes, the stop, and coefficients as near to the truth as theory has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import polefence as pf
from polefence.data import Response, search
from polefence.data.linear import Modes
from polefence.data.local import Model, Signals
from polefence.data.residual import Residual
from support.measurements import at, companion, exactly, in_time, names

NOISE = 0.02


def signals(plant):
    known = names(plant)
    return {"inputs": known["input_names"], "outputs": known["output_names"]}


def noisy(plant, source, count=600):
    """Responses whose noise is alike in all of them, and the sizes of the outputs."""
    clean = in_time(plant, source, count=count)
    sizes = sized(clean)
    return [
        replace(own, outputs=own.outputs
                + NOISE * sizes[:, None] * source.standard_normal(own.outputs.shape))
        for own in clean
    ]  # fmt: skip


def sized(responses):
    moved = [(own.outputs.T - own.outputs.mean(axis=1)).T for own in responses]
    return np.sqrt(np.mean(np.square(moved), axis=(0, 2)))


def squares(system, own, sizes):
    """What a system misses a response by, with the initial state and constants that are best."""
    A, B, C = system
    n, p = len(A), len(C)
    forced = exactly(A, B, C, own.time, own.inputs, np.zeros(n))
    free = [exactly(A, 0 * B, C, own.time, 0 * own.inputs, e) for e in np.eye(n)]
    ones = [np.outer(e, np.ones(own.count)) for e in np.eye(p)]
    Z = np.array([(row.T / sizes).T.ravel() for row in (*free, *ones)]).T
    y = ((own.outputs - forced).T / sizes).T.ravel()
    return float(((y - Z @ np.linalg.lstsq(Z, y, rcond=None)[0]) ** 2).sum())


@pytest.mark.parametrize("seed", range(4))
def test_slopes_are_differences_of_another_simulation(seed):
    source = np.random.default_rng(seed)
    n, m, p = 3, 2, 2
    A = source.standard_normal((n, n)) - 2 * np.eye(n)
    if seed == 3:  # poles that are nearly one
        A = np.diag([-1.0, -1.0 - 1e-7, -3.0])
    B, C = source.standard_normal((n, m)), source.standard_normal((p, n))
    time, u, x0 = np.arange(80) * 0.3, source.standard_normal((m, 80)), source.standard_normal(n)
    of_a, of_b = np.zeros((n, n, p, 80)), np.zeros((n, m, p, 80))
    for g, a, b in Modes(A, 0.3).slopes(B, C, u, "linear", x0):
        of_a += np.einsum("pi,jt->ijpt", g, a).real
        of_b += np.einsum("pi,jt->ijpt", g, b).real
    for slopes, moved in ((of_a, 0), (of_b, 1)):
        for i, j in np.ndindex(*slopes.shape[:2]):
            sides = []
            for sign in (1, -1):
                both = [A.copy(), B.copy()]
                both[moved][i, j] += sign * 1e-4
                sides.append(exactly(*both, C, time, u, x0))
            difference = (sides[0] - sides[1]) / 2e-4
            tolerance = 1e-6 * max(1, np.abs(difference).max())
            np.testing.assert_allclose(slopes[i, j], difference, rtol=0, atol=tolerance)


@pytest.mark.parametrize("seed", range(3))
def test_coefficients_are_as_near_as_noise_lets_them_be(seed):
    """The truth is missed by more than the fit, by chi squared of as many as are sought."""
    source = np.random.default_rng(seed)
    order = int(source.integers(2, 5))
    plant = companion(order, 1, 2, source)
    responses, words = noisy(plant, source), signals(plant)
    found, sizes = pf.identify(responses, order, **words), sized(responses)
    fitted = true = 0.0
    for own in responses:
        alpha = found.plant.alpha(q=own.at["q"])
        C = [alpha @ found.plant.signal(name).arrays(found.plant)[0] for name in words["outputs"]]
        fitted += squares((*found.plant.at(alpha), np.array(C)), own, sizes)
        true += squares(at(plant, own.at["q"]), own, sizes)
    k = found.unknowns
    assert abs((true - fitted) / NOISE**2 - k) < 4 * np.sqrt(2 * k)


def test_noise_ends_the_search(monkeypatch):
    """A search that goes on takes more slopes, and comes no nearer to what noise lets it know."""
    source = np.random.default_rng(5)
    plant = companion(4, 1, 2, source)
    responses, counts = noisy(plant, source), []
    linear = search.Search.linear

    def counted(self, theta):
        counts[-1] += 1
        return linear(self, theta)

    monkeypatch.setattr(search.Search, "linear", counted)
    found = []
    for share in (search.SHARE, 1e-12):
        monkeypatch.setattr(search, "SHARE", share)
        counts.append(0)
        found.append(pf.identify(responses, 4, **signals(plant)).data.all.rms)
    assert counts[0] < counts[1]
    assert counts[0] <= 6 * 5  # of all, and of all but each of four
    assert found[0] == pytest.approx(found[1], rel=2e-3)  # written in three digits


def test_outputs_may_have_the_names_of_other_states():
    plant = companion(4, 1, 2, np.random.default_rng(6))
    renamed = [
        replace(own, output_names=("x2", "x1")) for own in in_time(plant, np.random.default_rng(7))
    ]
    found = pf.identify(renamed, 4, inputs=["u0"], outputs=["x2 [m]", "x1 [m]"])
    assert found.data.all.largest < 1e-6
    assert len(set(found.plant.states)) == 4


def test_repeated_measurements_tell_as_much_as_one_that_is_longer():
    """Ten short ones at one point: the misfit is their noise."""
    source = np.random.default_rng(8)
    plant = companion(2, 1, 1, source)
    responses = [
        replace(own, name=f"{k}")
        for k, own in enumerate(in_time(plant, source, NOISE, 120, points=(1.5,) * 10))
    ]
    bare = [replace(own, at={}) for own in responses]
    found = pf.identify(bare, 2, **signals(plant))
    # 10 (2 + 1) initial values and 4 coefficients of 1200 numbers
    assert found.data.all.rms == pytest.approx(NOISE * np.sqrt(1 - 34 / 1200), rel=0.1)


def test_a_point_with_too_few_samples_is_refused():
    """Together they are enough; the change from one point to the other is not told."""
    source = np.random.default_rng(9)
    plant = companion(3, 2, 1, source)
    long, short = in_time(plant, source, points=(1.0, 2.0))
    few = Response(short.time[:6], short.inputs[:, :6], short.outputs[:, :6], short.at,
                   short.input_names, short.output_names, name="short")  # fmt: skip
    with pytest.raises(pf.InputError, match=r"do not determine|no model of order"):
        pf.identify([long, few], 3, **signals(plant))


@pytest.mark.parametrize("seed", range(2))
def test_a_free_mass_is_fitted_in_time(seed):
    """Its pole at zero comes out on either side: it is no instability that was measured."""
    source = np.random.default_rng(seed)
    A, B = np.array([[0.0, 1], [0, -1.0]]), np.array([[0.0], [1]])
    time = np.arange(500) * 0.05
    u = np.sin(time * (0.5 + 0.15 * time))[None]
    y = exactly(A, B, np.array([[1.0, 0]]), time, u, np.zeros(2))
    y += NOISE * y.std() * source.standard_normal(y.shape)
    found = pf.identify([Response(time, u, y)], 2, inputs=["u1"], outputs=["y1"])
    slow, fast = sorted(np.linalg.eigvals(found.plant.A[0]).real, key=abs)
    assert abs(slow) < 1 / 25
    assert fast == pytest.approx(-1, rel=0.2)
    assert found.data.all.rms == pytest.approx(NOISE, rel=0.15)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("pole", "moves"), [(0.7, True), (0.8, False)])
def test_a_response_that_diverges_has_no_slopes(pole, moves):
    """Within 40 s it grows by e^28, or by e^32, of which numbers tell nothing."""
    time, u = np.arange(401) * 0.1, np.ones((1, 401))
    own = Response(time, u, np.exp(-time)[None])
    signals = Signals(("u1",), ("y1",), np.zeros((1, 1), dtype=bool), 1)
    residual = Residual(signals, (("A", 0, 0), ("B", 0, 0)), np.ones(1))
    one = np.ones((1, 1))
    model = Model(pole * one, one, one, 0 * one)
    assert np.isfinite(residual.of(model, own)).all()
    slopes = residual.slopes(model, own)
    assert slopes.shape == (401, 2)
    assert slopes.any() == moves


def test_blas_has_one_thread(monkeypatch):
    """More of them wait for one another: where others work too a fit took 60 s in place of 1."""
    source, threads = np.random.default_rng(10), []
    cost = search.Search.cost

    def seen(self, theta):
        threads.extend(own["num_threads"] for own in threadpool_info() if own["user_api"] == "blas")
        return cost(self, theta)

    monkeypatch.setattr(search.Search, "cost", seen)
    plant = companion(2, 1, 1, source)
    with threadpool_limits(2, user_api="blas"):
        pf.identify(in_time(plant, source, count=200), 2, **signals(plant))
    assert set(threads) == {1}
