"""The Lyapunov matrix at given parameters, judged by its inequality at random ones, in floats."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import polefence as pf
from polefence.base.errors import InputError, ParameterValueError
from polefence.certify.bounds import best_bound
from polefence.certify.by_transfer import ByTransfer
from polefence.certify.lyapunov import lyapunov_matrix
from polefence.proof.claims.signal import SignalClaim
from polefence.proof.laws import Evidence, Law, Piece

K = [[-1.0, -1.5, 0.2]]
DRAWN = np.random.default_rng(7).uniform([1, 0.3], [2, 0.5], (12, 2))
POINTS = [{"k": k, "c": c} for k, c in DRAWN]
ENDS = [{"k": 1, "c": 0.3}, {"k": 2, "c": 0.3}, {"k": 2, "c": 0.5}]


@pytest.fixture(scope="module")
def plant():
    k, c = pf.Parameter("k", 1, 2, "N/m"), pf.Parameter("c", 0.3, 0.5, through="1/c")
    return pf.UncertainPlant.from_expressions(
        [k, c],
        [[0, 1, 0], ["-k", "-0.4", "1/c"], [0, 0, "-1/c"]],
        [[0], [0], [1]],
        [[0], [1], [0]],
        outputs={"place [m]": {"C": [1, 0, 0]}},
    )


def _loop(plant, law, values):
    """A + B K, from the entries as they are written."""
    k, c = values["k"], values["c"]
    A = np.array([[0, 1, 0], [-k, -0.4, 1 / c], [0, 0, -1 / c]])
    gain = law.gain_at(**values) if not isinstance(law, list) else np.array(law)
    return A + np.array([[0], [0], [1.0]]) @ gain


def _negative(F):
    return np.linalg.eigvalsh((F + F.T) / 2).max() < 0


def _falls(P, loop):
    return np.linalg.eigvalsh(P).min() > 0 and _negative(P @ loop + loop.T @ P)


def _keeps(P, loop, part):
    """Whether L (x) P + M (x) P A_c + M' (x) A_c'P < 0, or with M and M' exchanged."""
    for L, M in part.pairs():
        forms = [
            np.kron(L, P) + np.kron(own, P @ loop) + np.kron(own.T, loop.T @ P) for own in (M, M.T)
        ]
        if not any(map(_negative, forms)):
            return False
    return True


REGIONS = {
    "decay": pf.HalfPlane(0.3),
    "disk": pf.Disk(-6, 6),
    "three": pf.HalfPlane(0.2) & pf.Sector(0.15) & pf.Disk(-10, 12),
}


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize(
    "method", ["quadratic", "slack", "scheduled", pf.Scheduled(2, 1, "box")], ids=str
)
def test_that_of_a_design_keeps_every_part_of_its_region(plant, method, region):
    own = REGIONS[region]
    design = pf.place(plant, own, method)
    for values in POINTS + ENDS:
        loop = _loop(plant, design.law, values)
        for number, part in enumerate(own.parts):
            P = design.lyapunov_at(None, number, **values)
            assert np.array_equal(P, P.T)
            assert np.linalg.eigvalsh(P).min() > 0
            assert _keeps(P, loop, part), (values, part)


def test_that_of_a_gain_that_is_given(plant):
    region = pf.HalfPlane(0.1) & pf.Disk(-10, 12)
    found = pf.analyse(plant, K, region)
    assert found.proved
    design = pf.Design(found.certificate)
    for values in POINTS:
        for number, part in enumerate(region.parts):
            P = design.lyapunov_at(None, number, **values)
            assert _keeps(P, _loop(plant, K, values), part)


def test_weights_and_values_are_two_ways_to_one_matrix(plant):
    design = pf.place(plant, pf.HalfPlane(0.3), pf.Scheduled(2, 1, "box"))
    for values in POINTS:
        alpha = plant.alpha(**values)
        P = design.lyapunov_at(alpha)
        assert pytest.approx(P, rel=1e-9) == design.lyapunov_at(**values)


def test_it_is_of_the_law_after_it_was_saved(plant, tmp_path):
    design = pf.place(plant, pf.HalfPlane(0.3))
    design.save(tmp_path)
    other = pf.Design.load(tmp_path)
    assert np.array_equal(design.lyapunov_at(**POINTS[0]), other.lyapunov_at(**POINTS[0]))


def test_of_a_plant_in_discrete_time_it_falls_from_sample_to_sample(plant):
    law = pf.place(pf.at_sample_time(plant, 0.05), pf.Disk(0, 0.99))
    late = law.plant
    for values in POINTS:
        A, B = late.at(late.alpha(**values))
        gain = law.law.gain_at(**values)
        loop = A + B @ gain
        P = law.lyapunov_at(**values)
        assert np.linalg.eigvalsh(P).min() > 0
        assert _negative(loop.T @ P @ loop - P)


SPECIFICATIONS = [
    pf.Rms("place", density=2.0),
    pf.Gain("place"),
    pf.EnergyPeak("place", norm=1.0),
    pf.InitialPeak("place", points=((1.0, 0.0, 0.0),)),
]


@pytest.fixture
def by_matrices(monkeypatch):
    """Have bounds proved with Lyapunov matrices, where the transfer function would do."""
    monkeypatch.setattr(ByTransfer, "of", classmethod(lambda *own: None))


@pytest.mark.parametrize("own", SPECIFICATIONS, ids=lambda own: own.kind)
@pytest.mark.parametrize("scheduled", [False, True])
def test_that_of_a_bound_falls(plant, own, scheduled, by_matrices):
    law = pf.place(plant, pf.HalfPlane(0.3)).law if scheduled else pf.FixedGain(K)
    bound = best_bound(plant, law, own)
    assert bound is not None
    for values in POINTS + ENDS:
        P = bound.lyapunov_at(**values)
        assert _falls(P, _loop(plant, law, values)), values


def test_that_of_an_rms_bound_bounds_the_gramian(plant, by_matrices):
    own = pf.Rms("place", density=2.0)
    bound = best_bound(plant, pf.FixedGain(K), own)
    E, C = np.array([[0], [1.0], [0]]), np.array([[1.0, 0, 0]])
    dual = bound.claim.subject.evidence.dual
    for values in POINTS:
        loop, P = _loop(plant, K, values), bound.lyapunov_at(**values)
        if dual:
            gramian = solve_continuous_lyapunov(loop.T, -C.T @ C)
            assert np.linalg.eigvalsh(P - gramian).min() > 0
            assert float((E.T @ P @ E)[0, 0]) * 2.0 / 2 <= bound.level**2
        else:
            covariance = solve_continuous_lyapunov(loop, -E @ E.T * 2.0 / 2)
            assert np.linalg.eigvalsh(np.linalg.inv(P) - covariance).min() > 0


def test_in_parts_of_the_box_it_is_that_of_the_part():
    """Two coefficients that no one polynomial has: 1 on the left half, 4 on the right one."""

    one, zero, half = Fraction(1), Fraction(0), Fraction(1, 2)
    pieces = (
        Piece((zero,), (half,), Evidence([[[one]], [[3 * one]]], 1)),
        Piece((half,), (one,), Evidence([[[4 * one]], [[8 * one]]], 1)),
    )
    law, own = Law([[[zero]]]), Evidence([], cells=pieces)
    for t, X in ((zero, 1), (Fraction(1, 4), 2), (Fraction(3, 4), 6), (one, 8)):
        P = lyapunov_matrix(law, (2,), own, [1 - t, t])
        assert pytest.approx(np.array([[1 / X]])) == P


def test_what_is_no_point_is_refused_in_one_line(plant):
    design = pf.place(plant, pf.HalfPlane(0.3), pf.Scheduled(2, 1, "box"))
    with pytest.raises(ParameterValueError, match="missing: c"):
        design.lyapunov_at(k=1.5)
    with pytest.raises(ParameterValueError, match="unknown parameter 'm'"):
        design.lyapunov_at(k=1.5, c=0.4, m=1)
    with pytest.raises(InputError, match="not a product of weights of the parameters"):
        design.lyapunov_at([0.5, 0, 0, 0.5])
    with pytest.raises(InputError, match="not both"):
        design.lyapunov_at([1, 0, 0, 0], k=1)
    with pytest.raises(InputError, match="part = 1: the region's parts are 0 to 0"):
        design.lyapunov_at(None, 1, k=1.5, c=0.4)


def test_a_bound_by_the_transfer_function_has_none_and_says_so(plant):
    bound = best_bound(plant, pf.FixedGain(K), SPECIFICATIONS[0])
    assert bound.claim.subject.evidence.transfer
    with pytest.raises(InputError, match="without a Lyapunov matrix; design.lyapunov_at"):
        bound.lyapunov_at(k=1.5, c=0.4)


def test_a_bound_without_a_lyapunov_matrix_says_so(plant):
    law = pf.place(plant, pf.HalfPlane(0.3)).law
    bound = best_bound(plant, law, pf.GainNorm())
    assert not isinstance(bound.claim, SignalClaim)
    with pytest.raises(InputError, match="needs no Lyapunov matrix"):
        bound.lyapunov_at(k=1.5, c=0.4)
