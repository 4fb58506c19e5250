"""Bounds on signals: every block against the inequality at alpha, bounds against other theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import expm, solve_continuous_are, solve_continuous_lyapunov
from scipy.optimize import brentq, minimize_scalar

from polefence import Disk, FixedGain, HalfPlane, ScheduledGain, Sector, UncertainPlant
from polefence.certify.bounds import best_bound, kept_bound, own_evidence
from polefence.examples import family
from polefence.lmi.conditions.lyapunov import given
from polefence.lmi.conditions.methods import design
from polefence.lmi.conditions.performance import Demands, Output, Points, Through, noise
from polefence.lmi.conditions.target import Around, Target, fixed
from polefence.lmi.solve.loops import loop_with
from polefence.lmi.solve.lyapunov import least_given
from polefence.lmi.solve.performance import Problem, least
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.plant.outputs import Output as Signal
from polefence.plant.outputs import rate_of
from polefence.plant.polynomial import Domain
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.rms import Rms
from polefence.requirements.specification import floats, rows
from polefence.search.optimise import optimise
from polefence.vehicle.vehicle import quarter_car

FORMS = [
    (on, *form) for on in ("simplex", "box") for form in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0))
]
# (degree of the law, None for one gain; then as above)
GIVEN = [
    (degree, *form)
    for degree in (None, 0, 1)
    for form in FORMS
    # without parameters one gain is looked at on the simplex
    if not (degree is None and form[0] == "box")
]
REGION = HalfPlane(0.5) & Sector(0.3) & Disk(-4, 3)
MARGIN = 0.03


# --- every block ---------------------------------------------------------------------------------


class Family:
    """Vertices, sources and outputs of no meaning, and what they are at alpha."""

    def __init__(self, on, constant=False, seed=3, entries=1):
        random = np.random.default_rng(seed)
        self.domain = Domain.of(on, 4 if on == "box" else 3)
        N = self.domain.corners
        self.n, self.m, self.q = 3, 2, 2
        shapes = {"A": (3, 3), "B": (3, 2), "E": (3, 2)}
        shapes |= {"C": (entries, 3), "D": (entries, 2), "F": (entries, 2)}
        each = {name: random.normal(size=(N, *shape)) for name, shape in shapes.items()}
        if constant:
            each["E"] = np.repeat(each["E"][:1], N, axis=0)
        self.data = each
        self.x0 = random.normal(size=(2, N, 3, 1))
        sources = (
            noise("white", self.domain, each["E"], 0.7),
            Points("start", tuple(self.x0)),
            Through("way", each["E"]),
        )
        self.sources = {source.name: source for source in sources}

    def output(self, source, level, is_fixed):
        F = self.data["F"] if source == "way" else None
        name = f"{source} {level:g}"
        return Output(name, source, self.data["C"], self.data["D"], level, is_fixed, F)

    def at(self, matrices, alpha, degree=1):
        return np.tensordot(self.domain.basis(alpha, degree), matrices, 1)

    def expected(self, alpha, X, N, Y, t, r, outputs, margin):
        """Every inequality at alpha, by the name of its blocks."""
        E, F = (self.at(self.data[name], alpha) for name in "EF")
        drift = N + margin * X
        drift = -(drift + drift.T)
        found = {}
        for name in t:
            if name == "white":
                # of degree two in alpha, and no more
                found[name] = drift - t[name] * 0.7 * E @ E.T
            elif name == "start":
                found[name] = drift
                for k, vertices in enumerate(self.x0):
                    x0 = t[name] * self.at(vertices, alpha)
                    found[f"start {k + 1}"] = np.block([[t[name] * np.eye(1), x0.T], [x0, X]])
        for o in outputs:
            size, own = (1.0 if o.fixed else r), t[o.source]
            if o.source != "way":
                # rows side by side, X below each
                wide, p = Y.reshape(1, -1), len(Y)
                corner = size * o.level**2 * own * np.eye(1)
                found[o.name] = np.block([[corner, wide], [wide.T, np.kron(np.eye(p), X)]])
                continue
            whole = np.block(
                [
                    [-(N + N.T), -own * E, -Y.T],
                    [-own * E.T, size * o.level * own * np.eye(2), -own * F.T],
                    [-Y, -own * F, size * o.level * own * np.eye(len(Y))],
                ]
            )
            # the block has E and y over the root of the level
            change = np.diag([1.0] * 3 + [o.level**-0.5] * (2 + len(Y)))
            found[o.name] = change @ whole @ change
        return found


def value(block, values, r):
    """Return r D - M of a block, from its halves."""
    D, M = (
        sum((t.left @ values[t.name] @ t.right.T for t in half), np.zeros((block.size,) * 2))
        for half in (block.half_D, block.half_M)
    )
    return r * (D + D.T) - (M + M.T)


def summed(pencil, x, r, domain, coordinates, count):
    """Every inequality of a pencil at alpha, from its coefficients."""
    values = pencil.unpack(x)
    blocks = [(b.name, value(b, values, r)) for b in pencil.blocks]
    order = domain.monomials(count)
    weights = [np.prod(coordinates ** np.array(e)) for e in order]
    groups = {}
    for name, block in blocks:
        head, comma, _ = name.rpartition(", ")
        if not comma:
            head = "positive" if name.startswith("X at") else name
        groups.setdefault(head, []).append(block)
    found = {}
    for head, each in groups.items():
        assert len(each) in (1 if head.startswith("t ") else len(order), len(order))
        found[head] = sum(w * b for w, b in zip(weights, each, strict=len(each) > 1))
        if head.startswith("t "):
            found[head] = each[0]
    assert sum(map(len, groups.values())) == len(pencil.blocks)
    return found


def alphas(domain, count=2, seed=0):
    random = np.random.default_rng(seed)
    for _ in range(count):
        coordinates = np.concatenate([random.dirichlet(np.ones(size)) for size in domain.sizes])
        yield coordinates, domain.alpha(coordinates)


def compare(found, expected):
    assert set(found) == set(expected)
    for name, matrix in expected.items():
        assert found[name].shape == matrix.shape, name
        assert np.allclose(found[name], matrix, rtol=0, atol=1e-11), name


@pytest.mark.parametrize(("constant", "entries"), [(False, 1), (True, 1), (False, 3)])
@pytest.mark.parametrize(("on", "degree", "elevation"), FORMS)
def test_design_is_the_inequalities_at_alpha(on, degree, elevation, constant, entries):
    own = Family(on, constant, entries=entries)
    outputs = tuple(
        own.output(source, level, is_fixed)
        for source in own.sources
        for level, is_fixed in ((2.5, True), (0.6, False))
    )
    d, sources = own.data, tuple(own.sources.values())
    demands = Demands(Target(fixed(REGION, 2.0)), sources, outputs, margin=MARGIN)
    pencil = design(d["A"], d["B"], demands, own.domain, degree, elevation)
    x, r = np.random.default_rng(9).normal(size=pencil.unknowns), 0.37
    values, count = pencil.unpack(x), own.domain.count(degree)
    t = {name: values[f"t {name}"].item() for name in own.sources}
    # noise that varies with alpha has degree two, whatever that of W
    natural = max(degree + 1, 1 if constant else 2)
    for coordinates, alpha in alphas(own.domain):
        A, B, C, D = (own.at(d[name], alpha) for name in "ABCD")
        W, Z = (
            own.at(np.array([values[f"{name}{k + 1}"] for k in range(count)]), alpha, degree)
            for name in "WZ"
        )
        N, Y = A @ W + B @ Z, C @ W + D @ Z
        expected = own.expected(alpha, W, N, Y, t, r, outputs, MARGIN)
        expected |= {f"t {name}": r * value * np.eye(1) for name, value in t.items()}
        for number, (L, M) in enumerate(REGION.pairs(2.0)):
            part = np.kron(L, W) + np.kron(M, N) + np.kron(M.T, N.T)
            expected[f"part {number + 1}"] = -part
        compare(summed(pencil, x, r, own.domain, coordinates, natural + elevation), expected)


@pytest.mark.parametrize(
    ("source", "entries"), [("white", 1), ("start", 1), ("way", 1), ("white", 3), ("way", 2)]
)
@pytest.mark.parametrize(("scheduled", "on", "degree", "elevation"), GIVEN)
def test_given_is_the_inequalities_at_alpha(on, degree, elevation, scheduled, source, entries):
    own, random = Family(on, entries=entries), np.random.default_rng(4)
    d, domain = own.data, own.domain
    plant = UncertainPlant.from_vertices(d["A"], d["B"], d["E"])
    if scheduled is None:
        law = FixedGain(random.normal(size=(2, 3)))
    else:
        half = random.normal(size=(domain.count(scheduled), 3, 3))
        Z = random.normal(size=(len(half), 2, 3))
        law = ScheduledGain(half + half.swapaxes(1, 2), Z, (), scheduled, domain.sizes)
    loop = loop_with(plant, law, d["C"], d["D"])
    output = own.output(source, 1.7, False)
    demands = Demands(sources=(own.sources[source],), outputs=(output,))
    pencil = given(loop, demands, degree, elevation)
    x, r = random.normal(size=pencil.unknowns), 0.61
    values, count = pencil.unpack(x), domain.count(degree)
    t = {source: values[f"t {source}"].item()}
    natural = max(degree + 1 + 2 * (scheduled or 0), 2 if source == "white" else 1)
    for coordinates, alpha in alphas(domain):
        A, B, C, D = (own.at(d[name], alpha) for name in "ABCD")
        Q = own.at(np.array([values[f"Q{k + 1}"] for k in range(count)]), alpha, degree)
        if scheduled is None:
            K, X = law.K, Q
        else:
            W, Z = own.at(law.W, alpha, scheduled), own.at(law.Z, alpha, scheduled)
            s = own.at(np.array([values[f"s{k + 1}"] for k in range(count)]), alpha, degree)
            K, X = Z @ np.linalg.inv(W), s.item() * W + W @ Q @ W
        N, Y = (A + B @ K) @ X, (C + D @ K) @ X
        expected = own.expected(alpha, X, N, Y, t, r, (output,), 0.0)
        expected[f"t {source}"] = r * t[source] * np.eye(1)
        if source == "way":
            expected["positive"] = X
        found = summed(pencil, x, r, domain, coordinates, natural + elevation)
        size = max(1.0, *(np.abs(m).max() for m in expected.values()))
        compare(*({k: m / size for k, m in each.items()} for each in (found, expected)))


# --- one vertex: bounds are equalities -----------------------------------------------------------


def single(seed=2, n=3):
    random = np.random.default_rng(seed)
    A, B, E = random.normal(size=(n, n)), random.normal(size=(n, 1)), random.normal(size=(n, 2))
    return UncertainPlant.from_vertices([A], [B], [E])


OUTPUT = Signal("y", C=[1, 0, -0.5], D=[0.3])
FORCE = Signal("u", D=[1])


def mean_square(A, E, C):
    """E y^2 of x' = A x + E w, y = C x, for white noise of unit intensity."""
    return (C @ solve_continuous_lyapunov(A, -E @ E.T) @ C.T).item()


def nominal_car():
    A, B, E = quarter_car(289.0, 28.58, 10000.0, 155900.0, 850.0)
    A, B, E = np.array(A)[:4, :4], np.array(B)[:4], np.array(E)[:4]
    return UncertainPlant.from_vertices([A], [B], [E])


CAR_LAW = FixedGain([[-2000.0, 500.0, -900.0, 60.0]])
TYRE = Signal("tyre", "m", C=[0, 1, 0, 0])
ACCELERATION = rate_of(nominal_car(), "x3", "acceleration", "m/s^2")


def channel(plant, law, signal):
    """Closed loop, E and C + D K of one vertex."""
    (C,), (D,) = (floats(each) for each in rows(plant, signal))
    K = law.gain([1.0])
    return plant.A[0] + plant.B[0] @ K, plant.vertices[0].E, C + D @ K


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_force_limit_is_the_trade_off_of_riccati(share):
    plant = single()
    A, B, E = plant.A[0], plant.B[0], plant.vertices[0].E
    C, D = np.array([[1.0, 0, -0.5]]), np.array([[0.3]])

    def lqr(weight):
        X = solve_continuous_are(A, B, C.T @ C, D.T @ D + weight, s=C.T @ D)
        K = -np.linalg.solve(D.T @ D + weight, B.T @ X + D.T @ C)
        return [mean_square(A + B @ K, E, R) for R in (C + D @ K, K)]

    cheap, dear = lqr(1e-4)[1], lqr(1e4)[1]
    limit = dear + share * (cheap - dear)
    log = brentq(lambda log: lqr(np.exp(log))[1] - limit, np.log(1e-4), np.log(1e4), xtol=1e-12)
    expected = np.sqrt(lqr(np.exp(log))[0])
    limits = [Rms(FORCE, float(np.sqrt(limit)), 2.0)]
    found = optimise(plant, Rms(OUTPUT, None, 2.0), limits, method="scheduled")
    assert found.bounds[0].level == pytest.approx(expected, rel=1e-4)
    assert found.shared == pytest.approx(expected, rel=1e-4)
    # the optimum is at the limit, and nothing is below it
    A, E, row = channel(plant, found.law, FORCE)
    assert np.sqrt(mean_square(A, E, row)) == pytest.approx(np.sqrt(limit), rel=2e-3)
    assert found.bounds[0].level > expected * (1 - 1e-9)


@pytest.mark.parametrize("signal", [TYRE, ACCELERATION, FORCE], ids=lambda s: s.name)
def test_the_rms_of_a_law_is_that_of_lyapunovs_equation(signal):
    plant = nominal_car()
    A, E, C = channel(plant, CAR_LAW, signal)
    expected = np.sqrt(0.002 / 2 * mean_square(A, E, C))
    level = best_bound(plant, CAR_LAW, Rms(signal, None, 0.002)).level
    assert expected < level < expected * (1 + 1e-5)
    kept = Rms(signal, expected * (1 + 1e-4), 0.002)
    assert kept_bound(plant, CAR_LAW, kept) is not None
    assert kept_bound(plant, CAR_LAW, replace(kept, at_most=expected * (1 - 1e-4))) is None


@pytest.mark.parametrize("signal", [TYRE, FORCE], ids=lambda s: s.name)
def test_the_peak_under_bounded_energy_is_the_h2_norm(signal):
    plant = nominal_car()
    A, E, C = channel(plant, CAR_LAW, signal)
    expected = 0.3 * np.sqrt(mean_square(A, E, C))
    level = best_bound(plant, CAR_LAW, EnergyPeak(signal, None, 0.3)).level
    assert expected < level < expected * (1 + 1e-5)
    # the worst disturbance, w(T - s) = E' exp(A' s) C' over its norm, comes as near as one likes
    times = np.linspace(0, 8, 8001)
    step = expm(A * times[1])
    rows_ = [C]
    for _ in times[1:]:
        rows_.append(rows_[-1] @ step)
    impulse = np.array([(row @ E).item() for row in rows_])
    assert 0.3 * np.sqrt(trapezoid(impulse**2, times)) == pytest.approx(level, rel=1e-3)


@pytest.mark.parametrize("signal", [TYRE, ACCELERATION, FORCE], ids=lambda s: s.name)
def test_the_gain_is_the_largest_of_the_frequency_response(signal):
    control = pytest.importorskip("control")
    plant = nominal_car()
    A, E, C = channel(plant, CAR_LAW, signal)
    system = control.ss(A, E, C, 0)

    def size(log):
        return abs(system(1j * np.exp(log)))

    grid = np.linspace(np.log(1e-2), np.log(1e4), 301)
    k = int(np.argmax([size(log) for log in grid]))
    bounds = (grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)])
    fine = minimize_scalar(
        lambda log: -size(log), bounds=bounds, method="bounded", options={"xatol": 1e-10}
    )
    expected = max(-fine.fun, abs(system(0)))
    level = best_bound(plant, CAR_LAW, Gain(signal)).level
    assert expected * (1 - 1e-9) < level < expected * (1 + 1e-3)


def test_the_peak_of_a_first_order_loop_is_its_start():
    plant = UncertainPlant.from_vertices([[[-1.0]]], [[[1.0]]], [[[2.0]]])
    law, signal = FixedGain([[-1.0]]), Signal("x", C=[1])
    assert best_bound(plant, law, InitialPeak(signal, None, ((3.0,),))).level == pytest.approx(3.0)
    assert best_bound(plant, law, InitialPeak(signal, None, (), 0.5)).level == pytest.approx(1.0)
    # the larger of both counts
    both = InitialPeak(signal, None, ((-0.7,), (0.2,)), 0.5)
    assert best_bound(plant, law, both).level == pytest.approx(1.0)


@pytest.mark.parametrize("signal", [TYRE, FORCE], ids=lambda s: s.name)
@pytest.mark.parametrize(("points", "impulse"), [(((0.01, 0, 0, 0.2),), 0.0), ((), 0.02)])
def test_a_bound_on_the_peak_is_no_less_than_the_simulated_one(signal, points, impulse):
    plant = nominal_car()
    A, E, C = channel(plant, CAR_LAW, signal)
    level = best_bound(plant, CAR_LAW, InitialPeak(signal, None, points, impulse)).level
    step = expm(A * 1e-3)
    x = np.array(points[0])[:, None] if points else impulse * E
    peak = 0.0
    for _ in range(4000):
        peak, x = max(peak, abs((C @ x).item())), step @ x
    # one ellipsoid for all time is conservative, and no more than by a factor for these
    assert peak < level < 3 * peak


# --- families ------------------------------------------------------------------------------------


def simple(seed=0, N=2, spread=0.25):
    random = np.random.default_rng(seed)
    A = np.array([[0.0, 1.0], [-4.0, -1.0]]) + spread * random.normal(size=(N, 2, 2))
    B = np.array([[0.0], [1.0]]) + spread / 3 * random.normal(size=(N, 2, 1))
    E = np.array([[0.3], [1.0]]) + spread * random.normal(size=(N, 2, 1))
    return UncertainPlant.from_vertices(A, B, E)


# outputs that no stable law makes zero
SPECIFICATIONS = {
    "rms": Rms(Signal("y", C=[1, 0], D=[-0.1])),
    "energy": EnergyPeak(Signal("x2", C=[0, 1])),
    "initial": InitialPeak(Signal("x1", C=[1, 0]), None, ((0.3, 1.0),), 0.4),
    "gain": Gain(Signal("y", C=[1, 0], D=[-0.1])),
}


def outputs_of(plant, domain, specification):
    return specification.condition(plant, domain, 1.0)


def designed(plant, domain, specification, degree, region=None, force=1.0):
    """The least bound of a law whose force keeps a limit; without one laws grow for ever."""
    source, output = outputs_of(plant, domain, specification)
    size = getattr(specification, "norm", 1.0)
    none, one = np.zeros_like(output.C), np.full_like(output.D, force * size)
    limit = replace(output, name="force", C=none, D=one, level=3.0, fixed=True)
    rate = typical_rate(plant.A)
    scaling = balanced(plant.A, plant.B, rate)
    start = smallest(plant.A, plant.B, Around(region or HalfPlane(0)), "quadratic", enough=0.9)
    assert start.r < 1
    count = domain.count(degree)
    values = {f"{x}{k + 1}": start.values[x] for x in "WZ" for k in range(count)}
    outputs = (limit, output)
    question = Problem(plant.A, plant.B, (source,), outputs, region, domain, degree, 0)
    return least(question, values, scaling)


@pytest.mark.parametrize("kind", SPECIFICATIONS)
def test_a_higher_degree_or_elevation_is_never_worse(kind):
    plant, own = simple(), SPECIFICATIONS[kind]
    law = FixedGain([[-0.5, -0.8]])
    domain = Domain.of("simplex", 2)
    source, output = outputs_of(plant, domain, own)
    loop = loop_with(plant, law, output.C, output.D)
    found = {form: least_given(loop, source, output, *form).r for form in ((0, 0), (0, 1), (1, 0))}
    found |= {form: least_given(loop, source, output, *form).r for form in ((1, 1), (2, 0))}
    for low, high in (((0, 0), (0, 1)), ((0, 1), (1, 1)), ((1, 0), (1, 1)), ((1, 0), (2, 0))):
        assert found[high] <= found[low] * (1 + 1e-6)
    # and strictly better once: the orderings are no tautology
    assert found[2, 0] < found[0, 0] * (1 - 1e-4)
    # no bound is below what the vertices and points between have
    power = 1.0 if kind == "gain" else 0.5
    if kind in ("rms", "energy"):
        worst = 0.0
        for share in np.linspace(0, 1, 41):
            A, B, E, C, D = (
                share * m[0] + (1 - share) * m[1]
                for m in (plant.A, plant.B, [v.E for v in plant.vertices], output.C, output.D)
            )
            scale = 0.5 if kind == "rms" else 1.0
            worst = max(worst, scale * mean_square(A + B @ law.K, E, C + D @ law.K))
        assert found[2, 0] ** power >= np.sqrt(worst) * (1 - 1e-9)
        assert found[2, 0] ** power == pytest.approx(np.sqrt(worst), rel=0.02)


@pytest.mark.parametrize("kind", SPECIFICATIONS)
def test_a_shared_lyapunov_matrix_proves_no_less_a_bound_than_an_own_one(kind):
    plant, own, domain = simple(1), SPECIFICATIONS[kind], Domain.of("simplex", 2)
    power = 1.0 if kind == "gain" else 0.5
    region = HalfPlane(0.5) & Disk(-6, 5.9)  # the least gain asks for ever faster poles
    shared = {}
    for degree in (0, 1):
        point = designed(plant, domain, own, degree, region)
        shared[degree] = point.r**power
        W, Z = (
            np.array([point.values[f"{x}{k + 1}"] for k in range(domain.count(degree))])
            for x in "WZ"
        )
        law = ScheduledGain(W, Z, (), degree, domain.sizes)
        (t,) = point.t.values()
        bound = best_bound(plant, law, own, (own_evidence(law, W, t), shared[degree]))
        assert bound is not None
        assert bound.level <= shared[degree] * (1 + 2e-6)
    assert shared[1] <= shared[0] * (1 + 1e-6)
    assert designed(plant, domain, own, 1).r ** power <= shared[1] * (1 + 1e-6)


@pytest.mark.parametrize("kind", SPECIFICATIONS)
def test_bounds_do_not_depend_on_units(kind):
    plant, own, domain = simple(2), SPECIFICATIONS[kind], Domain.of("simplex", 2)
    T, S, rate = np.array([1e-3, 1e2]), 1e4, 1e-2  # x = T x', u = S u', t = t' / rate
    A = plant.A * T / T[:, None] / rate
    B = plant.B * S / T[:, None] / rate
    E = np.array([v.E for v in plant.vertices]) / T[:, None] / rate
    other = UncertainPlant.from_vertices(A, B, E)
    signal = own.signal
    C, D, _ = signal.arrays(plant)
    moved = Signal("y", C=C * T, D=D * S)
    changes = {"signal": moved}
    if kind == "rms":
        changes["density"] = own.density * rate
    elif kind == "energy":
        changes["norm"] = own.norm * rate**0.5
    elif kind == "initial":
        changes["points"] = tuple(tuple(np.array(p) / T) for p in own.points)
        changes["impulse"] = own.impulse * rate
    theirs = replace(own, **changes)
    K = np.array([[-0.5, -0.8]])
    bounds = [
        best_bound(each, FixedGain(gain), specification).level
        for each, gain, specification in ((plant, K, own), (other, K * T / S, theirs))
    ]
    assert bounds[1] == pytest.approx(bounds[0], rel=1e-6)
    squares = [
        designed(each, domain, specification, 1, force=force).r
        for each, specification, force in ((plant, own, 1.0), (other, theirs, S))
    ]
    assert squares[1] == pytest.approx(squares[0], rel=1e-5)


def test_the_shipped_car_has_the_vertices_that_are_compared_here():
    ride = family("quarter-car-ride")
    signal = ride.signal("sprung-mass acceleration")
    C, D = (floats(each) for each in rows(ride, signal))
    assert np.array_equal(C[:, 0], ride.A[:, 2])
    assert np.array_equal(D[:, 0], ride.B[:, 2])
