"""The interior point's reference: its operators, its optimality conditions, its path."""

import runpy
from dataclasses import replace

import numpy as np
import pytest

from polefence import Scheduled, build
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import interior_point as reference
from polefence.lmi.solve.engine import run
from polefence.lmi.solve.interior_point import least_radius
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import lyapunov_mean
from polefence.lmi.solve.smallest import smallest
from polefence.lmi.solve.stacked import stack
from support.margin import largest_margin
from support.paths import FAMILIES
from support.pencils import start

METHODS = ["quadratic", "slack", "scheduled", Scheduled(right_hand_sides=True)]
ENGINES = ["compiled", "numpy"]
# Infima at centre -40 from a multiprecision reference, and half of the last digit shown.
CAR = {
    "as_printed": (5e-5, {"quadratic": 33.6439, "slack": 33.5019, "scheduled": 29.0992}),
    "physical": (5e-6, {"quadratic": 34.84241, "slack": 34.29901, "scheduled": 29.07548}),
}


def definite(random, size):
    X = random.normal(size=(size, size))
    return X @ X.T + 0.1 * np.eye(size)


def in_order(stacked, blocks):
    """The blocks in the pencil's order."""
    arrays, found = dict(zip(stacked.sizes, blocks, strict=True)), []
    for family in stacked.families:
        found += list(arrays[family.size][family.where])
    assert sum(map(len, blocks)) == len(found)
    assert sorted(stacked.sequence) == list(range(len(found)))
    return [found[k] for k in np.argsort(stacked.sequence)]


def derivatives(pencil, r):
    """F_i for all unknowns, each as a list of blocks."""
    return [list(pencil.matrices(e, r).values()) for e in np.eye(pencil.unknowns)]


def inner(X, Y):
    return sum(np.vdot(x, y) for x, y in zip(X, Y, strict=True))


# --- operators -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize(("n", "m", "N"), [(3, 2, 3), (1, 1, 1), (2, 1, 4), (4, 3, 2)])
def test_the_stacked_operators_are_the_pencils(method, n, m, N, make_random):
    random = np.random.default_rng([n, m, N])
    plant, r = make_random(n, n, m, N), 2.5
    pencil = build(method, plant.A, plant.B, 3.0, definite(random, n))
    stacked = stack(pencil)
    x = random.normal(size=pencil.unknowns)
    D, M = (in_order(stacked, part) for part in stacked.parts(x))
    F, minus_M = (list(pencil.matrices(x, value).values()) for value in (r, 0.0))
    assert len(F) == len(pencil.blocks) == len(D)
    for d, m_, f, g in zip(D, M, F, minus_M, strict=True):
        assert np.allclose(r * d - m_, f, rtol=1e-12, atol=1e-12)
        assert np.allclose(-m_, g, rtol=1e-12, atol=1e-12)

    Y, Q = (
        [np.array([definite(random, s) for _ in range(c)]) for s, c in stacked.sizes.items()]
        for _ in range(2)
    )
    y, q = in_order(stacked, Y), in_order(stacked, Q)
    assert stacked.adjoint(r, Y) @ x == pytest.approx(inner(y, F), rel=1e-10)
    assert stacked.adjoint(r, Y, only_D=True) @ x == pytest.approx(inner(y, D), rel=1e-10)

    derivative = derivatives(pencil, r)
    left = [[a @ b for a, b in zip(f, y, strict=True)] for f in derivative]
    right = [[(a @ b).T for a, b in zip(f, q, strict=True)] for f in derivative]
    brute = np.array([[inner(a, b) for b in right] for a in left])
    assert np.abs(brute).max() > 1
    assert np.allclose(
        stacked.hessian(r, Y, Q), (brute + brute.T) / 2, rtol=1e-10, atol=1e-10 * brute.max()
    )


# --- where it ends -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize(("seed", "n", "m", "N"), [(1, 3, 1, 3), (4, 2, 2, 3), (8, 3, 2, 4)])
def test_it_ends_at_a_saddle_point(method, seed, n, m, N, make_random):
    """F(x, r) > 0, Y > 0, A_r* Y = nu t, <Y, D(x)> = 1 and <F, Y> ~ 0 leave no smaller r."""
    pencil, x, _ = start(make_random(seed, n, m, N), 3.0, method)
    stacked = stack(pencil)
    out = reference.run(stacked, x)
    assert out.converged
    Y = in_order(stacked, out.Y)
    F = list(pencil.matrices(out.x, out.r).values())
    D = [b - f for b, f in zip(pencil.matrices(out.x, out.r + 1).values(), F, strict=True)]
    assert min(np.linalg.eigvalsh(f)[0] for f in F) > 0
    assert min(np.linalg.eigvalsh(y)[0] for y in Y) > 0
    assert inner(Y, D) == pytest.approx(1, abs=1e-9)
    assert inner(F, Y) == pytest.approx(out.gap, rel=1e-3)
    assert 0 < inner(F, Y) <= 1e-8 * out.r
    derivative = derivatives(pencil, out.r)
    gradient = np.array([inner(f, Y) for f in derivative])
    t = stacked.adjoint(1.0, stacked.identity(), only_D=True)
    residual = gradient - t * (t @ gradient) / (t @ t)
    Y_sizes = [np.linalg.norm(y) for y in Y]
    sizes = [np.dot([np.linalg.norm(f) for f in F_i], Y_sizes) for F_i in derivative]
    assert np.linalg.norm(residual) <= 1e-7 * np.linalg.norm(sizes)
    # by so much could a point of this size fall below r
    assert np.abs(residual) @ np.abs(out.x) <= 1e-5 * out.r


@pytest.mark.parametrize("method", METHODS[:3])
@pytest.mark.parametrize(("seed", "n", "m", "N"), [(1, 3, 1, 3), (4, 2, 2, 3), (6, 3, 2, 3)])
def test_clarabel_brackets_the_radius(method, seed, n, m, N, make_random):
    plant, sigma = make_random(seed, n, m, N), 3.0
    found = smallest(plant.A, plant.B, Disks(-sigma), method, engine="numpy")
    scaling = balanced(plant.A, plant.B, sigma).refined(lyapunov_mean(found.values))
    pencil = build(method, *scaling.apply(plant.A, plant.B), sigma / scaling.rate)
    for side in (1e-4, 1e-6):
        above, below = (
            largest_margin(pencil, found.r * (1 + change) / scaling.rate)
            for change in (side, -side)
        )
        assert above.optimal
        assert below.optimal
        assert below.t / side < -1e-3 < 1e-3 < above.t / side


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS[:3])
@pytest.mark.parametrize("family", CAR)
def test_the_car_at_centre_40(family, method, engine, request):
    plant = request.getfixturevalue(family)
    digit, infima = CAR[family]
    found = smallest(plant.A, plant.B, Disks(-40.0), method, engine=engine)
    assert found.converged
    assert abs(found.r - infima[method]) <= digit + 1e-7 * found.r


# --- the path ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [38, 45, 57])
def test_folds_of_the_path_are_passed_at_prescribed_radii(seed, monkeypatch):
    """mu is no parameter of the path: runs that always prescribe it need far longer, or fail."""
    plant, centre = runpy.run_path(str(FAMILIES))["polytope"](seed)
    folded = smallest(plant.A, plant.B, Disks(centre), "quadratic", engine="numpy")
    always = property(lambda _: True, lambda *_: None)
    monkeypatch.setattr(reference._Arc, "smooth", always, raising=False)
    plain = smallest(plant.A, plant.B, Disks(centre), "quadratic", engine="numpy")
    assert folded.converged
    assert plain.iterations > 2 * folded.iterations
    assert plain.r >= folded.r * (1 - 1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_it_stops_at_the_first_radius_that_is_enough(method, engine, make_random, monkeypatch):
    pencil, x, _ = start(make_random(1, 3, 1, 3), 3.0, method)
    stacked = stack(pencil)
    r = 1.3 * least_radius(*stacked.parts(x))
    full = run(stacked, x, r, engine=engine)
    enough = (full.r + r) / 2
    out = run(stacked, x, r, enough, engine=engine)
    assert full.converged
    assert not out.converged
    assert full.r < out.r <= enough
    assert 0 < out.iterations < full.iterations
    monkeypatch.setattr(reference, "MAX_ITERATIONS", out.iterations - 1)
    before = run(stacked, x, r, enough, engine=engine)
    assert before.iterations == out.iterations - 1
    assert before.r > enough


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_the_centre_is_one_point_wherever_a_run_comes_from(method, engine, make_random):
    """The gradient of log det F is along t there; other beginnings have other steps."""
    pencil, x, _ = start(make_random(1, 3, 1, 3), 3.0, method)
    stacked = stack(pencil)
    r = 1.3 * least_radius(*stacked.parts(x))
    enough = (run(stacked, x, r, engine=engine).r + r) / 2
    runs = [run(stacked, x, k * r, enough, engine=engine, central=True) for k in (1.0, 1.1, 1.4)]
    t = stacked.adjoint(1.0, stacked.identity(), only_D=True)
    D, M = stacked.parts(runs[0].x)
    F = [enough * d - m for d, m in zip(D, M, strict=True)]
    slope = stacked.adjoint(enough, [np.linalg.inv(f) for f in F])
    assert slope == pytest.approx(t * (slope @ t) / (t @ t), abs=1e-6 * np.linalg.norm(slope))
    for out in runs:
        assert out.r == enough
        assert out.x == pytest.approx(runs[0].x, rel=1e-6, abs=1e-6 * np.abs(runs[0].x).max())
        for f, y in zip(F, out.Y, strict=True):  # its duals are those of the centre
            scaled = f @ y
            assert scaled == pytest.approx(
                np.broadcast_to(scaled[0, 0, 0] * np.eye(f.shape[1]), f.shape), abs=1e-5
            )
    plain = run(stacked, x, r, enough, engine=engine)
    assert plain.r < enough or not np.allclose(plain.x, runs[0].x, rtol=1e-3)


@pytest.fixture
def count(monkeypatch):
    """Iterations of all runs so far, those of Lemma 1 as a start included."""
    counts = []

    def counting(*arguments):
        outcome = run(*arguments)
        counts.append(outcome.iterations)
        return outcome

    monkeypatch.setattr("polefence.lmi.solve.search.run", counting)
    return counts


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS[:3])
def test_a_neighbour_is_a_better_start(method, engine, physical, count):
    A, B = physical.A, physical.B
    neighbour = smallest(A, B, Disks(-40.0), method, engine=engine)
    # a disk about this centre that holds the neighbour's
    near = replace(neighbour, r=neighbour.r + 1.0)
    count.clear()
    alone = smallest(A, B, Disks(-41.0), method, engine=engine)
    alone_count, count[:] = sum(count), []
    led = smallest(A, B, Disks(-41.0), method, near, engine=engine)
    assert np.isclose(led.r, alone.r, rtol=1e-6)
    assert 0 < sum(count) < alone_count


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_the_start_must_be_interior(method, engine, make_random):
    pencil, x, _ = start(make_random(1, 3, 1, 3), 3.0, method)
    stacked = stack(pencil)
    least = least_radius(*stacked.parts(x))
    assert run(stacked, x, 1.01 * least, engine=engine).converged
    indefinite = x.copy()
    first = pencil.variables[0]
    indefinite[: first.size] = first.pack(np.diag([1.0, 1.0, -0.1]))
    for point, r in ((x, least * (1 - 1e-6)), (x, 0.0), (x, -1.0), (indefinite, 1e3 * least)):
        with pytest.raises(np.linalg.LinAlgError):
            run(stacked, point, r, engine=engine)


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_iterations_do_not_climb_with_the_vertices(method, make_random):
    medians = []
    for N in (2, 4, 8):
        plants = [make_random(seed, 5, 1, N) for seed in range(3)]
        found = [smallest(plant.A, plant.B, Disks(-3.0), method) for plant in plants]
        assert all(f.converged and f.iterations > 3 for f in found)
        medians.append(np.median([f.iterations for f in found]))
    assert max(medians) < 30
