"""A law of controllable dampers: its bound between what every logic has and what a drive has."""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from polefence import InputError, NotProvedError, UncertainPlant, semi_active
from polefence.certify.refutation import lowest, refute_limits
from polefence.examples import family, spec_text
from polefence.plant.dampers import Damper
from polefence.plant.outputs import weighted_sum
from polefence.plant.spec import loads as loads_spec
from polefence.proof import squares
from polefence.proof.__main__ import main
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import pieces_of
from polefence.proof.dampers import Curve
from polefence.proof.document import check, loads
from polefence.proof.work import FormatError
from polefence.requirements.rms import Rms
from polefence.search.semi_active import unproved
from polefence.vehicle import SIGNALS, quarter_car, velocity_density

DENSITY = velocity_density("C", 20)
LOW, HIGH = 300, 3000
DAMPER = Damper("actuator force", "suspension deflection", LOW, HIGH)


def cars(*masses):
    """The car of Table 1 without its damper, of these sprung masses, four states."""
    found = [quarter_car(Fraction(m), Fraction("28.58"), 10000, 155900, 0) for m in masses]
    A = [[row[:4] for row in each[0][:4]] for each in found]
    B, E = ([each[k][:4] for each in found] for k in (1, 2))
    names = SIGNALS | {"states": SIGNALS["states"][:4]}
    return UncertainPlant.from_vertices(A, B, E, **names)


def cost(plant, rho, level=1.0):
    tyre = weighted_sum("tyre", "m", [(float(np.sqrt(rho)), plant.signal("tyre deflection"))])
    return Rms(["sprung-mass acceleration", tyre], level, DENSITY)


def driven(plant, cases, seconds=30.0, step=1e-3, count=400):
    """The rms in many long drives: half a step's noise, a step, the other half.

    Of each alpha, law and rho; all drive over the same noise, side by side.
    """
    source = np.random.default_rng(5)
    alphas, laws, rhos = zip(*cases, strict=True)
    A, B = (np.tensordot(np.array(alphas, float), M, 1) for M in (plant.A, plant.B))
    E = np.array(plant.vertices[0].exact_E, float) * np.sqrt(DENSITY / 4 * step)
    (rate,) = np.array(laws[0].claim.dampers[0].rate[0], float)
    asked = np.concatenate([A, [[law.K[0], rate] for law in laws]], axis=1)

    def moved(x):
        free, u, v = np.split(asked @ x, (4, 5), axis=1)
        low, high = LOW * v, HIGH * v
        u = np.minimum(np.maximum(u, np.minimum(low, high)), np.maximum(low, high))
        return free + B * u

    x, total, steps = np.zeros((len(cases), 4, count)), [], int(seconds / step)
    for k in range(steps):
        x = x + E * source.standard_normal(count)
        x = x + step * moved(x + step / 2 * moved(x))
        x = x + E * source.standard_normal(count)
        if k >= steps // 6 and k % 5 == 0:  # nothing changes faster
            each = moved(x)[:, 2] ** 2 + np.reshape(rhos, (-1, 1)) * x[:, 1] ** 2
            total.append(each.mean(axis=1))
    return np.sqrt(np.mean(total, axis=0)).tolist()


@pytest.fixture(scope="module")
def car():
    return cars("288.9")


@pytest.fixture(scope="module")
def laws(car):
    return {rho: semi_active(car, cost(car, rho), [DAMPER]) for rho, *_ in TABLE}


@pytest.fixture(scope="module")
def skyhook(car):
    return semi_active(car, cost(car, 4e3), [DAMPER], K=[[0, 0, -4000, 0]])


@pytest.fixture(scope="module")
def reached(car, laws, skyhook):
    """What the laws have in drives, by rho, and what the skyhook has."""
    cases = [((1,), law, rho) for rho, law in laws.items()]
    found = driven(car, [*cases, ((1,), skyhook, 4e3)])
    return dict(zip([*laws, "skyhook"], found, strict=True))


# docs/semi-active.md: what is proved of the law; best damper that stays; the law in drives [m/s2]
TABLE = [(1.0, 0.812, 0.923, 0.722), (4e3, 0.888, 0.985, 0.814), (1.5e4, 1.054, 1.118, 1.001)]
TABLE += [(4e4, 1.300, 1.334, 1.262), (1e5, 1.664, 1.686, 1.630)]


@pytest.mark.parametrize(("rho", "proved", "stays"), [row[:3] for row in TABLE])
def test_the_bounds_of_a_known_car(laws, rho, proved, stays):
    law = laws[rho]
    assert law.degree == 6
    assert prove(law.claim).proved
    assert [law.level, law.passive] == pytest.approx([proved, stays], abs=1e-3)
    assert law.level < law.passive


@pytest.mark.parametrize(("rho", "drives"), [row[::3] for row in TABLE])
def test_a_drive_lies_between_what_every_logic_has_and_the_bound(car, laws, reached, rho, drives):
    low = refute_limits(car, [cost(car, rho, 1e-3)], [DAMPER])
    assert 1e-3 * low.factor < reached[rho] < laws[rho].level
    assert reached[rho] < 0.97 * laws[rho].passive
    assert reached[rho] == pytest.approx(drives, rel=3e-3)


def test_a_higher_degree_proves_more_and_two_what_the_best_damper_has(car):
    found = [semi_active(car, cost(car, 4e3), [DAMPER], degree) for degree in (2, 4, 6)]
    levels = [law.level for law in found]
    assert levels == sorted(levels, reverse=True)
    assert levels[0] == pytest.approx(found[0].passive, rel=1e-3)


def test_the_damper_that_stays_is_the_best(car, laws):
    law = laws[4e3]

    def rms(c):
        damper = Damper(DAMPER.force, DAMPER.deflection, c, c * (1 + 1e-9))
        found = refute_limits(car, [cost(car, 4e3, 1e-3)], [damper])
        return 1e-3 * found.factor

    best = minimize_scalar(rms, bounds=(LOW, HIGH), method="bounded", options={"xatol": 1})
    assert law.passive == pytest.approx(best.fun, rel=2e-3)
    assert law.coefficients[0] == pytest.approx(best.x, rel=0.05)


def test_a_demand_that_is_given_is_judged(car, laws, skyhook, reached):
    assert laws[4e3].level < skyhook.level < skyhook.passive
    assert reached["skyhook"] < skyhook.level
    assert [skyhook.level, reached["skyhook"]] == pytest.approx(
        [0.928, 0.819], abs=2e-3
    )  # the page's
    with pytest.raises(InputError, match="K is 1 x 3, not 1 x 4"):
        semi_active(car, cost(car, 4e3), [DAMPER], K=[[0, 0, 1]])


def test_a_damper_that_may_hardly_change_proves_what_it_has_when_it_stays(car):
    near = Damper(DAMPER.force, DAMPER.deflection, 1000, 1001)
    law = semi_active(car, cost(car, 4e3), [near], 2)
    assert law.level == pytest.approx(law.passive, rel=1e-3)


def test_a_family_has_one_law_and_one_bound():
    plant = cars("288.9", "388.9")
    law = semi_active(plant, cost(plant, 4e3), [DAMPER], 4)
    assert prove(law.claim).proved
    assert law.level < law.passive
    loads = ((1, 0), (0.5, 0.5), (0, 1))
    assert max(driven(plant, [(alpha, law, 4e3) for alpha in loads], seconds=20)) < law.level
    assert not prove(replace(law.claim, V=law.claim.V[::-1])).proved


def test_a_half_car_has_two_dampers():
    plant = family("half-car")
    ends = ("front", "rear")
    dampers = [Damper(f"{k} force", f"{k} suspension deflection", 300, 2000) for k in ends]
    tyres = [weighted_sum(k, "m", [(60.0, plant.signal(f"{k} tyre deflection"))]) for k in ends]
    limit = Rms([plant.signal("driver acceleration"), *tyres], 1.0, DENSITY)
    law = semi_active(plant, limit, dampers[::-1])
    assert law.degree == 2
    assert prove(law.claim).proved
    assert law.level == pytest.approx(law.passive, rel=3e-3)
    assert [own.force for own in law.dampers] == ["front force", "rear force"]


# --- the algebra, another way --------------------------------------------------------------------


def test_the_completed_matrices_are_the_inequality_at_any_point(laws):
    claim = laws[4e3].claim
    (A, B), E = (np.array(M[0], float) for M in (claim.A, claim.B)), np.array(claim.E[0], float)
    K, (v,) = np.array(claim.K, float), np.array(claim.dampers[0].rate[0], float)
    units = np.array(list(map(float, claim.units)))
    powers = np.array(squares.monomials(4, 6, 0)[1:])
    V = np.array(list(map(float, claim.V[0])))
    rows = [(np.array(y.C[0][0], float), float(y.D[0][0][0])) for y in claim.limit.outputs]
    bases, lower = squares.bases(4, 3), squares.bases(4, 2)
    source = np.random.default_rng(1)

    def at(xi):
        return float(V @ np.prod(xi**powers, axis=1))

    def square(G, basis, xi):
        m = np.prod(xi ** np.array(basis), axis=1)
        return float(m @ np.array(G, float) @ m)

    noise = float(claim.limit.intensity) ** 0.5 * E[:, 0] / units
    for own, (group, choice) in zip(claim.pieces, pieces_of((1,), [3]), strict=True):
        completed = list(claim._completed(own, group, claim._chosen(choice)))
        for xi in source.standard_normal((5, 4)):
            x, h = units * xi, 1e-4
            u = (K[0] @ x, LOW * v @ x, HIGH * v @ x)[choice[0]]
            above, below = K[0] @ x - LOW * v @ x, K[0] @ x - HIGH * v @ x
            form = (-above * below, -above * (v @ x), below * (v @ x))[choice[0]]
            moved = (A @ x + B[:, 0] * u) / units
            drift = (at(xi + h * moved) - at(xi - h * moved)) / (2 * h)
            drift += (at(xi + h * noise) + at(xi - h * noise) - 2 * at(xi)) / h**2 / 2
            left = 1 - sum((C @ x + D * u) ** 2 for C, D in rows) / float(claim.limit.level) ** 2
            left -= drift
            left -= form * sum(
                square(H, b, xi) for H, b in zip(*own.multipliers, lower, strict=True)
            )
            right = sum(square(G, b, xi) for G, b in zip(completed, bases, strict=True))
            assert left == pytest.approx(right, rel=1e-3, abs=1e-3)


# --- files ---------------------------------------------------------------------------------------


def test_a_file_of_the_bound_and_of_what_no_logic_keeps(car, laws, tmp_path, capsys):
    paths = [laws[4e3].save(tmp_path)]
    found = refute_limits(car, [cost(car, 4e3, 1e-3)], [DAMPER])
    paths.append(found.save(tmp_path))
    for path in paths:
        document = loads(path.read_text())
        assert document.write() == loads(document.dumps()).write()
        assert check(document).proved
        assert main([str(path)]) == 0
    said = capsys.readouterr().out
    assert "clipped to 300 to 3000 times (-x3 + x4)" in said
    assert "<= 0.88" in said
    assert "no semi-active law, u1 from 300 to 3000 times (-x3 + x4), keeps rms of" in said
    assert "<= 0.705" in said


def test_a_file_that_was_changed_proves_nothing(laws, tmp_path):
    text = laws[4e3].save(tmp_path).read_text()
    wrong = tmp_path / "wrong.json"
    for old, new, status in (
        ('"low": 300', '"low": 200', 1),
        ('"high": 3000', '"high": 4000', 1),
        ('"degree": 6', '"degree": 5', 2),
        ('"degree": 6', '"degree": 4', 2),
        ('"input": 1', '"input": 2', 2),
        ('"units": [', '"units": [0, ', 2),
    ):
        assert text.count(old) == 1
        wrong.write_text(text.replace(old, new))
        assert main([str(wrong)]) == status, old


def test_a_law_that_no_claim_is_about_is_refused(car, laws, tmp_path, capsys):
    """A reader would take the file's law for the one that is proved."""
    data = laws[4e3].file().write()
    m, n = car.shape[::-1]
    data["law"] = {"kind": "fixed", "K": [["0"] * n] * m}
    path = tmp_path / "law.json"
    path.write_text(json.dumps(data))
    assert main([str(path)]) == 2
    assert "law: none of the claims is about it" in capsys.readouterr().err


# --- faults --------------------------------------------------------------------------------------


def test_each_fault_in_the_evidence_is_found(laws):
    claim = laws[4e3].claim
    (damper,), limit = claim.dampers, claim.limit

    def spoiled(**new):
        return replace(claim, dampers=(replace(damper, **new),))

    def level(factor):
        return replace(claim, limit=replace(limit, level=limit.level * Fraction(factor)))

    zero = Fraction(0)
    wrong = [
        level("0.999"),
        replace(claim, limit=replace(limit, intensity=limit.intensity * Fraction("1.01"))),
        replace(claim, K=[[-x for x in row] for row in claim.K]),
        replace(claim, K=[[zero] * 4]),
        replace(claim, X=[[[-x for x in row] for row in claim.X[0]]]),
        replace(claim, X=[[[zero] * 4 for _ in range(4)]]),
        replace(claim, V=(tuple(-x for x in claim.V[0]),)),
        replace(claim, pieces=claim.pieces[1:] + claim.pieces[:1]),
        spoiled(low=Curve.line(Fraction(250))),
        spoiled(high=Curve.line(Fraction(3300))),
        spoiled(rate=[[[-x for x in damper.rate[0][0]]]]),
    ]
    for k in range(len(claim.V[0])):  # each coefficient as it is, times a little more
        if abs(claim.V[0][k]) > max(map(abs, claim.V[0])) / 100:
            V = list(claim.V[0])
            V[k] *= Fraction("1.1")
            wrong.append(replace(claim, V=(tuple(V),)))
    assert len(wrong) > 15
    for own in wrong:
        assert not prove(own).proved
    assert prove(level("1.0000001")).proved


@pytest.mark.parametrize("scale", [0, -1])
def test_noise_that_does_not_act_bounds_nothing(laws, scale):
    claim = laws[4e3].claim
    q = len(claim.E[0][0])
    with pytest.raises(FormatError, match="not all zero"):
        prove(replace(claim, scales=(Fraction(scale),) * q))


def test_each_matrix_of_squares_is_needed(laws):
    claim = laws[4e3].claim
    for k, piece in enumerate(claim.pieces):
        # not so of piece.grams: what is given there is only where the completion begins
        negative = replace(piece, multipliers=(tuple(map(_negative, piece.multipliers[0])),))
        pieces = (*claim.pieces[:k], negative, *claim.pieces[k + 1 :])
        assert "multiplier" in prove(replace(claim, pieces=pieces)).reason
        H = [list(row) for row in piece.multipliers[0][0]]
        H[0][1] += 1
        skew = replace(piece, multipliers=((H, piece.multipliers[0][1]),))
        pieces = (*claim.pieces[:k], skew, *claim.pieces[k + 1 :])
        assert "not symmetric" in prove(replace(claim, pieces=pieces)).reason


def _negative(G):
    return [[-x for x in row] for row in G]


def test_what_does_not_fit_is_refused(laws):
    claim = laws[4e3].claim
    (damper,) = claim.dampers
    for wrong, words in (
        (replace(claim, dampers=()), "one for each input"),
        (replace(claim, V=()), "V must hold 129 numbers"),
        (replace(claim, V=(claim.V[0][1:],)), "V must hold 129 numbers"),
        (replace(claim, pieces=claim.pieces[1:]), "pieces must be 3"),
        (replace(claim, degree=4), "V must hold 45 numbers"),
        (replace(claim, degree=3), "degree must be even"),
        (replace(claim, X=claim.X * 2), "X holds 2 matrices, not 1"),
        (replace(claim, sizes=(2,)), "alpha has 2 corners, not 1"),
        (replace(claim, units=claim.units[1:]), "units must hold 4 numbers"),
        (replace(claim, scales=(Fraction(1),) * 2), "disturbances must hold 1"),
        (replace(claim, K=claim.K * 2), "K 1 is not 1 x 4"),
        (replace(claim, limit=replace(claim.limit, level=Fraction(0))), "positive"),
        (replace(claim, limit=replace(claim.limit, outputs=())), "of outputs"),
        (
            replace(claim, dampers=(replace(damper, low=Curve.line(Fraction(3001))),)),
            "low must not be above",
        ),
    ):
        with pytest.raises(FormatError, match=words):
            prove(wrong)


def test_where_nothing_can_be_proved_it_says_why(car):
    A, B, E = (np.array(getattr(car.vertices[0], k)) for k in ("A", "B", "E"))
    pushed = A.copy()
    pushed[2, 2] += 50  # the body is driven by its own velocity
    names = {k: SIGNALS[k] for k in ("inputs", "disturbances")}
    first, signal = SIGNALS["states"][:4], "tyre deflection"
    limit = Rms([weighted_sum("force", "N", [(1e-3, car.signal("actuator force"))]), signal], 1.0)
    unstable = UncertainPlant.from_vertices([pushed], [B], [E], states=first, **names)
    with pytest.raises(NotProvedError, match="no dampers that stay, between their bounds, keep"):
        semi_active(unstable, limit, [DAMPER])
    A = np.block([[A, np.zeros((4, 1))], [np.zeros((1, 4)), -np.eye(1)]])
    B, E = (np.vstack([M, [[0.0]]]) for M in (B, E))
    apart = UncertainPlant.from_vertices([A], [B], [E], states=[*first, "clock"], **names)
    with pytest.raises(NotProvedError, match="no disturbance reaches clock"):
        semi_active(apart, limit, [DAMPER])


def test_of_what_no_bound_is_proved_it_says_why_and_what_to_change(car):
    own, heavier = cost(car, 4e3), cars("288.9", "388.9")
    tyres = UncertainPlant.from_vertices(
        [np.array(A) for A in heavier.A],
        [np.array(B) for B in heavier.B],
        [np.array(heavier.vertices[0].exact_E, float) * k for k in (1, 2)],
        **{k: names for k, names in SIGNALS.items() if k not in ("vehicle", "states")},
        states=SIGNALS["states"][:4],
    )
    moving = loads_spec(spec_text("semi-active").replace('"1/m1"', '"1/m1"\nrate = [-5, 5]', 1))
    asked = Rms(["sprung-mass acceleration", "tyre share"], 1, DENSITY)
    spring = Damper("damper force", "suspension deflection", 300, 3000)
    for plant, limit, damper, words in (
        (car, own, replace(DAMPER, low=0), "force = 0 v, vertex 1 is not stable; raise the lower"),
        (car, Rms("tyre deflection", 1, DENSITY), DAMPER, "has no force in it; add an accel"),
        (tyres, Rms("actuator force", 1, DENSITY), DAMPER, "how the disturbance enters"),
        (moving, asked, spring, "m1 moves; bounds are proved for constant parameters; leave out"),
    ):
        with pytest.raises(NotProvedError, match=words):
            semi_active(plant, limit, [damper])
        found = unproved(plant, limit, [damper])  # and yet this is known
        assert damper.low <= found.coefficients[0] <= damper.high
        low = lowest(plant, limit, found.passive, [damper])
        assert low is not None
        assert 0 < low[1] < found.passive


def test_questions_that_are_none_are_refused(car):
    own = cost(car, 4e3)
    for plant, limit, dampers, degree, words in (
        (car, own, [], None, "give one damper for each of 1 inputs"),
        (car, own, [DAMPER, DAMPER], None, "give one damper for each of 1 inputs"),
        (car, own, [DAMPER], 3, "degree = 3 must be 2, 4, 6 or 8"),
    ):
        with pytest.raises(InputError, match=words):
            semi_active(plant, limit, dampers, degree)


def test_every_monomial_is_a_product_of_two_of_a_basis():
    for n, degree in product((1, 2, 4), (2, 4, 6, 8)):
        found = {
            squares.joined(e, f)
            for basis in squares.bases(n, degree // 2)
            for e in basis
            for f in basis
        }
        assert found == set(squares.monomials(n, degree, 0))
        assert len(found) == squares.count_of(n, degree)
