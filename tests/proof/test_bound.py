"""Lower bounds by the compiled prover: thresholds, the rationals' bounds, no untruth."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from polefence import Scheduled, UncertainPlant
from polefence.certify import lower_bound as bound
from polefence.certify.lower_bound import lower_radius
from polefence.certify.repair import lower_bound
from polefence.lmi.conditions.methods import method_name
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import engine
from polefence.lmi.solve.smallest import smallest
from polefence.search.by_lmi import smallest_disk
from polefence.search.many import tightest

compiled = pytest.mark.skipif(
    not hasattr(engine.kernel(), "lower"), reason="installed without a compiler: no second prover"
)
RIGHT = Scheduled(right_hand_sides=True)
METHODS = ["quadratic", "slack", "scheduled", RIGHT]
CASES = [(3, 3, 1, 3), (4, 2, 1, 5), (5, 3, 2, 4), (12, 4, 1, 2)]  # seed, n, m, N


def dual(plant, method, sigma):
    """The radius that the search finds, and its dual matrices in the plant's coordinates."""
    found = smallest(plant.A, plant.B, Disks(-sigma), method)
    return found.r, found.dual.matrices()


def ask(plant, method, sigma, upper, Y):
    name = method if isinstance(method, str) else method_name(method)
    return lower_radius(plant, name, sigma, upper, Y, method is RIGHT)


def exact(plant):
    return [
        [[list(row) for row in matrix] for matrix in matrices]
        for matrices in ([v.exact_A for v in plant.vertices], [v.exact_B for v in plant.vertices])
    ]


@compiled
@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_its_bounds_are_those_of_rationals(case, method, make_random):
    plant = make_random(*case)
    upper, Y = dual(plant, method, 3.0)
    ours = ask(plant, method, 3.0, upper, Y)
    theirs = lower_bound(method_name(method), *exact(plant), Fraction(3), upper, Y, method is RIGHT)
    assert ours is not None
    assert ours < upper
    assert abs(ours - float(theirs.r)) <= 1.1e-6 * upper


@compiled
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_the_car_is_bounded_without_rationals(method, physical, monkeypatch):
    monkeypatch.setattr("polefence.search.by_lmi.lower_bound", lambda *_: pytest.fail("asked"))
    design, found = smallest_disk(physical, -40.0, method)
    assert found.r * (1 - 1e-6) <= design.lower < found.r


# Half the interval of poles; |a + sigma| (b2 - b1) / (b2 + b1).
SCALARS = [((-1, 3), (1, 1), 5.0, 2.0), ((2, 2), (1, 3), 3.0, 2.5)]


@compiled
@pytest.mark.parametrize("method", ["quadratic", "slack"])
@pytest.mark.parametrize(("a", "b", "sigma", "infimum"), SCALARS)
def test_what_a_law_reaches_is_proved_out_of_reach_by_no_matrices(a, b, sigma, infimum, method):
    """Of scalar plants the infimum is known: up to it there is a proof, from there on none."""
    plant = UncertainPlant.from_vertices([[[v]] for v in a], [[[v]] for v in b])
    upper, Y = dual(plant, method, sigma)
    assert infimum * (1 - 2e-6) <= ask(plant, method, sigma, upper, Y) < infimum
    random = np.random.default_rng(0)
    for wide in (2e-6, 1e-4, 0.1):
        for size in (0, *10.0 ** random.uniform(-12, 0, 20)):
            noise = random.normal(size=Y.shape) * size
            tried = Y * (1 + noise + noise.swapaxes(1, 2))
            found = ask(plant, method, sigma, infimum * (1 + wide), tried)
            assert found is None or found < infimum


@compiled
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_what_a_point_proves_is_not_proved_out_of_reach(method, make_random):
    """At a radius of which a law is proved no matrices near the dual's may say otherwise."""
    plant, random = make_random(5, 3, 2, 3), np.random.default_rng(1)
    _, Y = dual(plant, method, 3.0)
    design, _ = smallest_disk(plant, -3.0, method, bounds=False)
    assert design.proved
    above = design.region.radius * (1 + 2e-6)
    for size in (0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0):
        for _ in range(6):
            noise = size * random.normal(size=Y.shape)
            found = ask(plant, method, 3.0, above, Y * (1 + noise + noise.swapaxes(1, 2)))
            assert found is None or found < design.region.radius


@compiled
@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_units_far_apart_change_nothing(method, make_random):
    plant = make_random(3, 3, 1, 3)
    U = np.diag([2.0**-20, 1.0, 2.0**23])
    A, B = np.linalg.inv(U) @ plant.A @ U, np.linalg.inv(U) @ plant.B
    far = UncertainPlant.from_vertices(A, B)
    upper, Y = dual(far, method, 3.0)
    assert upper * (1 - 1.1e-6) <= ask(far, method, 3.0, upper, Y) < upper


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
@pytest.mark.parametrize(("states", "inputs"), [((0, 0), 230), ((0, 0), -300), ((150, -150), 0)])
def test_of_units_beyond_the_kernels_rationals_bound(states, inputs, method, make_random):
    """In powers of two: such units change no bound, and end no search."""
    near = make_random(4, 2, 1, 3)
    T = 2.0 ** np.array(states, dtype=float)
    far = UncertainPlant.from_vertices(
        near.A * T[:, None] / T, near.B * T[:, None] * 2.0**inputs, name=near.name
    )
    lower = smallest_disk(near, -3.0, method)[0].lower
    alone, _ = smallest_disk(far, -3.0, method)
    (many,) = tightest([far], -3.0, method)
    assert alone.lower == pytest.approx(lower, rel=1e-5)
    assert many.lower == alone.lower


@compiled
def test_what_cannot_be_used_is_none(make_random, monkeypatch):
    plant = make_random(2, 2, 1, 3)
    upper, Y = dual(plant, "quadratic", 3.0)
    assert ask(plant, "quadratic", 3.0, upper, Y) is not None
    for wrong in (Y[:2], Y[:, :3, :3], -Y, 0 * Y, Y * np.nan, np.roll(Y, 1, axis=1)):
        assert ask(plant, "quadratic", 3.0, upper, wrong) is None
    assert ask(plant, "quadratic", 3.0, 0.0, Y) is None
    assert ask(plant, "lyapunov", 3.0, upper, Y) is None
    monkeypatch.setattr(bound, "kernel", lambda: None)
    assert ask(plant, "quadratic", 3.0, upper, Y) is None
    assert smallest_disk(plant, -3.0, "quadratic")[0].lower is not None  # by rationals


# --- its door: one fault at a time ---------------------------------------------------------------

NAMES = (
    *("slack", "right_hand_sides", "joint", "plant", "sigma", "Y", "Psi"),
    *("scale", "rho", "radii"),
)


def arguments(plant, method, monkeypatch):
    """What the kernel is given for the search's dual matrices, and what it says."""
    taken, real = [], engine.kernel()

    class Spy:
        def lower(self, *given):
            taken.append(given)
            return real.lower(*given)

    upper, Y = dual(plant, method, 3.0)
    with monkeypatch.context() as patched:
        patched.setattr(bound, "kernel", Spy)
        assert ask(plant, method, 3.0, upper, Y) is not None
    return dict(zip(NAMES, taken[0], strict=True))


@compiled
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_every_part_of_the_evidence_counts(method, make_random, monkeypatch):
    given = arguments(make_random(5, 2, 1, 3), method, monkeypatch)
    given["radii"] = given["radii"][:5]
    door = engine.kernel().lower
    assert door(**given) >= 0

    def proved(**changes):
        return door(**{**given, **changes}) >= 0

    n, Y = 2, given["Y"]
    assert not proved(sigma=given["sigma"] - 0.5)
    assert not proved(radii=given["radii"] * 1.01)
    assert not proved(Psi=0 * given["Psi"])
    assert not proved(Psi=2.1 * given["Psi"])
    assert not proved(Y=0 * Y)
    assert not proved(Y=-Y)
    b = int(np.einsum("bii->b", Y).argmax())  # of small ones other matrices may take the part
    mirrored, lopsided, missing = Y.copy(), Y.copy(), Y.copy()
    mirrored[b, :n, n:] *= -1
    mirrored[b, n:, :n] *= -1
    lopsided[b, 0, 1] *= 1 + 2**-50
    missing[b] = 0.0
    for faulty in (mirrored, lopsided, missing):
        assert not proved(Y=faulty)
    if given["slack"]:
        unequal = Y.copy()
        unequal[0, 0, 0] *= 1 + 2**-50
        assert not proved(Y=unequal)
    powers, data, denominator, states, words = given["plant"]
    rolled = data[len(data) // 3 :] + data[: len(data) // 3]  # vertices in another order
    assert not proved(plant=(powers, rolled, denominator, states, words))


@compiled
@pytest.mark.parametrize("weak", [0, 10, 100, 600])
def test_what_underflows_counts(weak):
    """x' = u 2^-weak reaches any radius: the change that B'X = 0 asks for is the whole of X."""
    words, scale, x = weak // 64 + 2, 2.0**-199, 0.99
    numbers = [own.to_bytes(8 * words, "little", signed=True) for own in (0, 1, 2**weak)]
    given = {
        "slack": False,
        "right_hand_sides": False,
        "joint": True,
        "sigma": 1.0,
        "plant": (np.eye(1, dtype=np.int64), numbers[0] + numbers[1], numbers[2], 1, words),
        "Y": scale**2 * np.array([[[1.0, x], [x, 1.0]]]),
        "Psi": np.array([[[2.0**weak]]]),
        "scale": np.array([scale]),
        "rho": np.array([[1 / scale]]),
        "radii": np.array([0.98]),
    }
    assert engine.kernel().lower(**given) < 0


@compiled
def test_its_door_refuses_what_does_not_fit(make_random, monkeypatch):
    given = arguments(make_random(5, 2, 1, 3), "scheduled", monkeypatch)
    powers, data, denominator, n, words = given["plant"]
    wrong = [
        {"plant": (powers[:2].copy(), data, denominator, n, words)},
        {"plant": (powers, data[:-8], denominator, n, words)},
        {"plant": (powers, data, denominator, n + 1, words)},
        {"sigma": np.inf},
        {"Y": given["Y"] * np.nan},
        {"Y": given["Y"][:, :3, :3].copy()},
        {"Y": given["Y"][:2]},
        {"Y": given["Y"][:-1]},
        {"Psi": given["Psi"][:, :, :0].copy()},
        {"Psi": given["Psi"][:2]},
        {"Psi": given["Psi"] * np.inf},
        {"scale": given["scale"][:1]},
        {"scale": given["scale"] * 1.5},
        {"scale": given["scale"] * 0},
        {"rho": given["rho"][:1]},
        {"rho": -given["rho"]},
        {"rho": given["rho"] * np.nan},
        {"radii": -given["radii"]},
        {"radii": given["radii"] * np.inf},
        {"radii": given["radii"] * 1e70},
        {"slack": True},
        {"joint": True},
    ]
    for change in wrong:
        with pytest.raises((ValueError, TypeError)):
            engine.kernel().lower(**{**given, **change})
