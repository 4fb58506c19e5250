"""Bounds with a form for each damper: regions, the inequality, faults, half and full cars."""

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from test_damper_curves import HIGH, LOW, curve
from test_other_dampers import DENSITY, half

from polefence import NotProvedError, semi_active
from polefence.certify.refutation import lowest
from polefence.examples import spec_text
from polefence.plant.dampers import Damper
from polefence.plant.outputs import weighted_sum
from polefence.plant.spec import loads
from polefence.proof import squares
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import groups_of
from polefence.proof.dampers import Curve
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.sectors import regions_of
from polefence.proof.work import FormatError
from polefence.requirements.rms import Rms

SOFT, HARD = ([[str(v), 0.9 * F] for v, F in own] for own in (LOW, HIGH))
DAMPERS = [
    Damper("front force", "front suspension deflection", LOW, HIGH),
    Damper("rear force", "rear suspension deflection", SOFT, HARD),
]


@pytest.fixture(scope="module")
def law():
    """A half car with two measured dampers, its load uncertain."""
    plant, asked, _ = half(aged=False)
    return semi_active(plant, asked, DAMPERS)


def force(damper, q, v):
    """What it gives, from its points alone."""
    ends = [curve([[float(x) for x in p] for p in own.points], v) for own in damper.curves]
    return np.clip(q, min(ends), max(ends))


# --- regions -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high"),
    [(300, 3000), (LOW, HIGH), (LOW, 9000), ([[-1, -350], [0.5, 175], [1, 300]], HIGH[:-1])],
)
def test_regions_cover_the_plane_and_say_the_force(low, high):
    own = Damper("force", "deflection", low, high)
    regions = regions_of(_bare(own))
    source = np.random.default_rng(1)
    for _ in range(500):
        v = source.choice([0.0, 0.1, -0.1, source.standard_normal()])
        q = source.standard_normal() * 1000
        point = np.array([q, v, 1.0])
        inside = [
            np.array(r.force, float) @ point
            for r in regions
            if min(np.array(r.lines, float) @ point) >= 0
        ]
        assert inside
        assert inside == pytest.approx([float(force(own, q, v))] * len(inside), abs=1e-9)


def _bare(damper):
    from polefence.proof.dampers import SemiActive

    return SemiActive(0, [], *damper.curves)


# --- the claim -----------------------------------------------------------------------------------


def test_a_half_car_with_measured_dampers_is_bounded_by_its_best_dampers(law):
    assert check(read(law.file().dumps())).proved
    low = lowest(law.plant, law.specification, law.passive, law.dampers)
    assert low[1] < law.level < law.passive * 1.0001
    assert len(law.claim.sectors) == 2
    assert not law.claim.pieces
    assert not law.claim.even


def test_each_form_is_nowhere_negative_on_what_its_damper_does(law):
    source = np.random.default_rng(3)
    for own, damper in zip(law.claim.sectors, DAMPERS, strict=True):
        form, least = np.array(own.form, float), np.inf
        for _ in range(2000):
            v = source.standard_normal() * 10 ** source.uniform(-2, 1)
            q = source.standard_normal() * 10 ** source.uniform(0, 4)
            y = np.array([q, v, float(force(damper, q, v)), 1.0])
            least = min(least, y @ form @ y / (np.abs(y) @ np.abs(form) @ np.abs(y)))
        assert -1e-12 < least < 0.1  # it is used, and holds


def test_the_mean_falls_at_random_points(law):
    """V along the true motion, by differences, with what the dampers' points say of the forces."""
    claim, source = law.claim, np.random.default_rng(8)
    n, units = 8, np.array(claim.units, float)
    powers = np.array(squares.known(n, 2, False)[1:])
    A, B, V = (np.array(M, float) for M in (claim.A, claim.B, claim.V))
    outputs = claim.limit.outputs
    C, D = (np.array([[getattr(y, k)[j][0] for y in outputs] for j in (0, 1)], float) for k in "CD")
    E = np.array(claim.E[0], float) * float(claim.limit.intensity) ** 0.5 / units[:, None]
    K, rates = np.array(claim.K, float), np.array([d.rate[0][0] for d in claim.dampers], float)
    least = np.inf
    for _ in range(500):
        alpha = source.dirichlet((0.6, 0.6))
        A1, B1, C1, D1, V1 = (np.tensordot(alpha, M, 1) for M in (A, B, C, D, V))
        xi = source.standard_normal(n) * 10 ** source.uniform(-1.5, 1)
        x = units * xi
        u = np.array([force(d, q, v) for d, q, v in zip(DAMPERS, K @ x, rates @ x, strict=True)])
        z, moved = C1 @ x + D1 @ u, (A1 @ x + B1 @ u) / units

        def at(point, V1=V1):
            return V1 @ np.prod(point**powers, axis=1)

        drift = (at(xi + moved) - at(xi - moved)) / 2  # of a quadratic function exact
        drift += sum((at(e) + at(-e)) / 2 for e in E.T)
        left = 1 - z @ z / float(claim.limit.level) ** 2 - drift
        least = min(least, left / (1 + abs(drift) + z @ z))
    assert -1e-9 < least < 0.2


def test_the_inequality_is_that_of_the_module_at_any_state_and_force(law):
    claim, source = law.claim, np.random.default_rng(2)
    n, m = 8, 2
    A, B, V, K = (np.array(M, float) for M in (claim.A, claim.B, claim.V, claim.K))
    units = np.array(claim.units, float)
    rates = np.array([d.rate[0][0] for d in claim.dampers], float)
    powers = np.array(squares.known(n, 2, False)[1:])
    E = np.array(claim.E[0], float) * float(claim.limit.intensity) ** 0.5 / units[:, None]
    rows = [claim._open(j) for j in range(2)]
    groups = groups_of(claim.alpha)
    for _ in range(10):
        alpha, xi, u = source.dirichlet((1, 1)), source.standard_normal(n), source.normal(size=m)
        y, total = np.array([*xi, *(1000 * u), 1.0]), 0.0
        for group in groups:
            weight = alpha[group[0][0]] * alpha[group[0][1]]
            total += weight * (y @ np.array(claim._free(group, rows), float) @ y)
        x, u = units * xi, 1000 * u
        A1, B1, V1 = (np.tensordot(alpha, M, 1) for M in (A, B, V))
        moved = (A1 @ x + B1 @ u) / units
        z = sum(
            (
                np.tensordot(alpha, np.array(out.C, float), 1)[0] @ x
                + np.tensordot(alpha, np.array(out.D, float), 1)[0] @ u
            )
            ** 2
            for out in claim.limit.outputs
        )

        def at(point, V1=V1):
            return V1 @ np.prod(point**powers, axis=1)

        left = 1 - z / float(claim.limit.level) ** 2
        left -= (at(xi + moved) - at(xi - moved)) / 2 + sum((at(e) + at(-e)) / 2 for e in E.T)
        for k, own in enumerate(claim.sectors):
            place = np.array([K[k] @ x, rates[k] @ x, u[k], 1.0])
            left -= place @ np.array(own.form, float) @ place
        assert total == pytest.approx(left, rel=1e-8)


# --- faults --------------------------------------------------------------------------------------


def test_each_fault_in_the_evidence_is_found(law):
    claim = law.claim
    first, second = claim.sectors
    limit, zero = claim.limit, Fraction(0)

    def with_form(k, factor):
        form = [list(row) for row in first.form]
        form[k][k] *= factor
        return replace(claim, sectors=(replace(first, form=form), second))

    def with_share(k, value):
        shares = list(first.shares)
        shares[k] = (value, *shares[k][1:])
        return replace(claim, sectors=(replace(first, shares=tuple(shares)), second))

    negative = [[-x for x in row] for row in first.form]
    wrong = [
        replace(claim, limit=replace(limit, level=limit.level * Fraction("0.999"))),
        replace(claim, limit=replace(limit, intensity=limit.intensity * Fraction("1.01"))),
        replace(claim, K=claim.K[::-1]),
        replace(claim, V=claim.V[::-1]),
        replace(claim, X=[[[-x for x in row] for row in X] for X in claim.X]),
        replace(claim, sectors=(second, first)),
        replace(claim, sectors=(replace(first, form=negative), second)),
        *(with_form(k, Fraction(f)) for k in (1, 2) for f in ("0.9", "1.1")),
        *(with_share(k, -first.shares[k][0]) for k in range(len(first.shares))),
        *(with_share(k, zero) for k in range(0, len(first.shares), 5)),
    ]
    for key in ("low", "high"):  # curves that are wider than those that were proved
        points = getattr(claim.dampers[0], key).points
        for k in (0, len(points) - 1):
            changed = list(points)
            factor = Fraction("0.4") if key == "low" else Fraction("2.5")
            changed[k] = (points[k][0], points[k][1] * factor)
            other = replace(claim.dampers[0], **{key: Curve(tuple(changed))})
            wrong.append(replace(claim, dampers=(other, claim.dampers[1])))
    assert prove(claim).proved
    proved = [k for k, own in enumerate(wrong) if prove(own).proved]
    assert not proved
    skew = [list(row) for row in first.form]
    skew[0][1] += 1
    broken = replace(claim, sectors=(replace(first, form=skew), second))
    assert "not symmetric" in prove(broken).reason


def test_what_does_not_fit_is_refused(law):
    claim = law.claim
    first, second = claim.sectors
    for wrong, words in (
        (replace(claim, sectors=(first,)), "one for each damper"),
        (replace(claim, sectors=()), "pieces must be 432"),
        (replace(claim, V=[V[:-1] for V in claim.V]), "V must hold 44 numbers"),
        (replace(claim, degree=4), "V must hold 494 numbers"),
        (replace(claim, sectors=(replace(first, shares=first.shares[1:]), second)), "a share for"),
        (replace(claim, sectors=(replace(first, form=first.form[1:]), second)), "must be 4 x 4"),
    ):
        with pytest.raises(FormatError, match=words):
            prove(wrong)


# --- other cars ----------------------------------------------------------------------------------


def test_a_degree_that_asks_for_too_many_pieces_is_refused_before_it_begins(law):
    with pytest.raises(NotProvedError, match=r"degree 4 has 432 pieces .* take degree 2, which"):
        semi_active(law.plant, law.specification, DAMPERS, 4)


def test_a_full_car_with_four_measured_dampers_is_bounded():
    text = re.sub(r"\ndamper = .*", "\ndamper = 0", spec_text("full-car"))
    text = re.sub(r"\[parameter.age\].*\nrange.*\n", "", text).replace("*(1 + age)", "")
    plant = loads(text)
    corners = [f"{end} {side}" for end in ("front", "rear") for side in ("left", "right")]
    shares = [weighted_sum(k, "m", [(60.0, plant.signal(f"{k} tyre deflection"))]) for k in corners]
    asked = Rms([plant.signal("driver acceleration"), *shares], 1.0, DENSITY)
    dampers = [Damper(f"{k} force", f"{k} suspension deflection", SOFT, HARD) for k in corners]
    law = semi_active(plant, asked, dampers)
    assert check(read(law.file().dumps())).proved
    assert law.level < 1.1 * law.passive


def test_a_line_that_is_given_by_points_proves_what_a_range_does():
    plant, asked, straight = half(aged=False)
    points = [
        replace(d, low=[[-1, -300], [0, 0], [1, 300]], high=[[-2, -5000], [0, 0], [3, 7500]])
        for d in straight
    ]
    found = [semi_active(plant, asked, own, 2).level for own in (straight, points)]
    assert found[0] == found[1]
