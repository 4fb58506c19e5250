"""Laws as doubles evaluate them, against exact rationals; and where rounding moves poles out."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import Disk, HalfPlane, Scheduled, Sector, UncertainPlant, check, limits, place
from polefence import tightest as tightest_of
from polefence.certify.candidates import first
from polefence.certify.certificate import Certificate
from polefence.certify.design import Design
from polefence.certify.evaluation import (
    SAFETY,
    TOLERANCE,
    UNIT,
    _Loops,
    _places,
    lyapunovs,
    rounding_share,
)
from polefence.certify.given import analyse
from polefence.cli.laws import read_law
from polefence.cli.main import main
from polefence.law.coordinates import Coordinates
from polefence.law.laws import FixedGain, ScheduledGain, right_divide
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.smallest import smallest
from polefence.plant.polynomial import Domain
from polefence.proof import matrices as definite
from polefence.proof import matrices as exactly
from polefence.proof import polynomials, regions, roots
from polefence.proof.matrices import mix
from polefence.region.text import digits_up
from polefence.search.by_lmi import _designs
from polefence.search.limits import Limit
from support.commands import ran

# A helicopter and a moored floating platform, HE1 and MFP of F. Leibfritz, COMPleib: constrained
# matrix-optimization problem library, 2004.
HELICOPTER = (
    [
        [-0.0366, 0.0271, 0.0188, -0.4555],
        [0.0482, -1.01, 0.0024, -4.0208],
        [0.1002, 0.3681, -0.707, 1.42],
        [0, 0, 1, 0],
    ],
    [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0, 0]],
)
PLATFORM = (
    [
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [-0.101, -0.1681, -0.04564, -0.01075],
        [0.06082, -2.1407, -0.05578, -0.1273],
    ],
    [[0, 0, 0], [0, 0, 0], [0.1179, 0.1441, 0.1476], [0.1441, 1.7057, -0.7557]],
)


def uncertain(matrices, N: int, share: float) -> UncertainPlant:
    """Vertices whose entries are off by up to a share."""
    A, B = (np.array(M, dtype=float) for M in matrices)
    random = np.random.default_rng(0)
    As = [A * (1 + share * random.uniform(-1, 1, A.shape)) for _ in range(N)]
    return UncertainPlant.from_vertices(
        As, [B * (1 + share * random.uniform(-1, 1, B.shape)) for _ in range(N)]
    )


CASES = {
    "helicopter at -3": (HELICOPTER, 2, 0.02, -3.0),
    "helicopter at -30": (HELICOPTER, 2, 0.02, -30.0),
    "helicopter, three": (HELICOPTER, 3, 0.05, -0.3),
    "platform at -1": (PLATFORM, 2, 0.02, -1.0),
    "platform, three": (PLATFORM, 3, 0.05, -1.0),
}


@pytest.fixture(scope="module")
def sharpest():
    """The smallest disk that is proved at all, whatever doubles make of the law."""
    found = {}
    for name, (matrices, N, share, centre) in CASES.items():
        plant = uncertain(matrices, N, share)
        point = smallest(plant.A, plant.B, Disks(centre), "scheduled")
        found[name] = first(_designs(plant, centre, "scheduled", point))
    return found


def rationals(matrix):
    return [[Fraction(float(e)) for e in row] for row in matrix]


def exact_gain(law, alpha):
    """K(alpha), alpha a list of fractions."""
    basis = polynomials.basis(polynomials.coordinates(alpha, law.sizes), law.sizes, law.degree)
    W, Z = ([rationals(M) for M in each] for each in (law.W, law.Z))
    return exactly.right_divide(mix(basis, Z), mix(basis, W))


def places(N):
    random = np.random.default_rng(4)
    shares = [[int(j == k) for j in range(N)] for k in range(N)]
    shares += [[1] * N, *random.integers(1, 1000, (4, N)).tolist()]
    return [[Fraction(int(s), int(sum(row))) for s in row] for row in shares]


def difference(K, other):
    """K, of doubles, minus exact numbers, in doubles."""
    return np.array(
        [[float(k - e) for k, e in zip(*rows, strict=True)] for rows in zip(K, other, strict=True)]
    )


@pytest.mark.parametrize("name", CASES)
def test_the_gain_is_that_of_the_file_where_division_in_doubles_is_not(sharpest, name):
    law, plain, own = sharpest[name].law, 0.0, 0.0
    for alpha in places(len(law.W)):
        other = exact_gain(law, alpha)
        size = max(abs(float(e)) for row in other for e in row)
        weights = np.array(alpha, dtype=float)
        divided = right_divide(np.tensordot(weights, law.Z, 1), np.tensordot(weights, law.W, 1))
        plain = max(plain, np.abs(difference(rationals(divided), other)).max() / size)
        own = max(own, np.abs(difference(rationals(law.gain(weights)), other)).max() / size)
    assert own < 1e-6
    assert plain > 1000 * own


@pytest.mark.parametrize("name", ["helicopter at -3", "helicopter at -30", "helicopter, three"])
def test_what_rounding_is_judged_to_take_it_does(sharpest, name):
    """What the error of K in doubles, against exact rationals, takes of F where W(alpha) = I."""
    design = sharpest[name]
    law, plant, region = design.law, design.plant, design.region
    (pair,), taken, judged = region.pairs(), [], []
    L, M = pair
    for alpha in places(len(law.W)):
        weights = np.array(alpha, dtype=float)
        ((_, lyapunov),) = lyapunovs(design.certificate)
        loops = _Loops.of(design.certificate, lyapunov, weights[None])
        judged.append(loops.shares(pair, region)[0])
        off = difference(rationals(law.gain(weights)), exact_gain(law, alpha))
        T = law.coordinates
        C = np.linalg.cholesky(np.tensordot(weights, law.even[0], 1))
        B = np.linalg.solve(C, np.tensordot(weights, T.inputs(plant.B), 1))
        moved, n = B @ off @ T.inverse @ C, len(C)
        closed = loops.closed[0]
        F = -np.kron(L, np.eye(n)) - np.kron(M, closed) - np.kron(M.T, closed.T)
        half = np.linalg.cholesky(F + TOLERANCE * region.size * np.eye(2 * n))
        change = np.linalg.solve(half, np.kron(M, moved) + np.kron(M.T, moved.T))
        taken.append(np.abs(np.linalg.eigvalsh(np.linalg.solve(half, change.T))).max())
    assert max(taken) < max(judged)
    assert max(judged) < 200 * max(taken)


def inside(design, alpha, radius):
    """Whether K(alpha) of doubles keeps all poles in a disk about the centre, exactly."""
    claim = design.certificate.claim()
    A, B = mix(alpha, claim.A), mix(alpha, claim.B)
    K = rationals(design.law.gain([float(a) for a in alpha]))
    closed = [
        [a + sum(b * k[j] for b, k in zip(bs, K, strict=True)) for j, a in enumerate(row)]
        for row, bs in zip(A, B, strict=True)
    ]
    part = regions.Disk(Fraction(design.region.centre), Fraction(radius))
    return roots.all_inside(closed, (part,))


@pytest.mark.parametrize("name", CASES)
def test_the_smallest_disk_is_of_a_law_that_doubles_run(sharpest, name):
    matrices, N, share, centre = CASES[name]
    design = tightest_of(uncertain(matrices, N, share), centre)
    assert design.runs
    assert design.note == ""
    radius = design.region.radius
    assert all(inside(design, alpha, radius * (1 + TOLERANCE)) for alpha in places(N))
    # what it gives up is little, and is not given up without need
    assert radius < 1.1 * sharpest[name].region.radius
    if design.unrunnable is None:
        assert sharpest[name].runs
    else:
        assert design.unrunnable < radius


def test_a_law_that_doubles_cannot_run_is_called_so(sharpest, tmp_path, capsys):
    design = sharpest["platform, three"]
    assert check(design).proved
    assert not design.runs
    assert "rounding takes" in design.note
    design = sharpest["platform at -1"]
    assert not design.runs
    path = design.save(tmp_path)
    assert "does NOT keep the poles there: rounding takes" in check(path).reason
    assert "does NOT keep" in check(design.certificate).reason
    assert "does NOT keep" in ran(capsys, "check", path)
    runs = tightest_of(design.plant, design.region.centre)
    assert "NOT" not in check(runs).reason


SPEC = """
name = "platform"
[[vertex]]
A = {}
B = {}
[[vertex]]
A = {}
B = {}
"""


def test_commands_say_what_was_given_up(tmp_path, capsys):
    plant = uncertain(PLATFORM, 2, 0.02)
    spec, rows = tmp_path / "platform.toml", tmp_path / "rows.json"
    spec.write_text(
        SPEC.format(*(M.tolist() for pair in zip(plant.A, plant.B, strict=True) for M in pair))
    )
    words = [str(spec), "--centre", "-1", "--method", "scheduled", "--json", str(rows)]
    assert main(["limits", *words]) == 0
    said = "is proved too, but only of a law that doubles cannot evaluate"
    (row,) = json.loads(rows.read_text())["rows"]
    given_up = digits_up(row["unrunnable"])
    assert f"note: centre -1, scheduled: {given_up} {said}" in capsys.readouterr().out
    assert row["runs"]
    assert row["unrunnable"] < row["radius"] < 1.1 * row["unrunnable"]
    assert said in ran(capsys, "tightest", "--of", "disk", *words)
    summary = json.loads(rows.read_text())
    assert summary["unrunnable"] == row["unrunnable"]
    assert summary["value"] == row["radius"]


def test_rows_without_a_law_do_not_run():
    assert not Limit(-1.0, "slack", None, "undecided", 0.1).runs
    plant = uncertain(HELICOPTER, 2, 0.02)
    (row,) = limits(plant, -3, "quadratic", bounds=False)
    assert row.runs
    assert row.unrunnable is None


# --- other methods and regions -------------------------------------------------------------------


@pytest.fixture(scope="module")
def oscillator():
    As = [[[0, 1], [-k, -1]] for k in (1, 9)]
    return UncertainPlant.from_vertices(As, [[[0], [1]]] * 2)


def test_all_methods_and_regions_are_judged(oscillator):
    region = HalfPlane(1) & Sector(0.5) & Disk(-5, 4.9)
    for method in ("quadratic", "slack", "scheduled", Scheduled(2, 0)):
        design = place(oscillator, region, method)
        assert 0 < design.rounding < 1e-6, method
        again = analyse(oscillator, design.law, region)
        assert again.proved
        assert 0 < again.design.rounding < 1e-6, method


@pytest.mark.parametrize(("of", "key"), [("half_plane", "decay"), ("sector", "damping")])
def test_decay_and_damping_step_back_too(oscillator, monkeypatch, of, key):
    """Suppose that doubles run laws of nine tenths of the best value, and no better."""
    within = Disk(-5, 4.9) if of == "half_plane" else HalfPlane(0.5) & Disk(-5, 4.9)

    def best():
        return tightest_of(oscillator, of=of, within=within, method="quadratic")

    sharpest = best()
    value = sharpest.region.parts[0].numbers[key]
    assert sharpest.unrunnable is None
    runs = property(lambda design: design.region.parts[0].numbers[key] < 0.9 * value)
    monkeypatch.setattr(Design, "runs", runs)
    design = best()
    assert design.unrunnable == value
    assert 0.8 * value < design.region.parts[0].numbers[key] < 0.9 * value


@pytest.mark.parametrize("region", [Disk(-5, 4.9), HalfPlane(0.5) & Sector(0.3)])
def test_a_law_is_returned_where_none_runs(oscillator, monkeypatch, region):
    monkeypatch.setattr(Design, "runs", property(lambda design: False))
    design = place(oscillator, region, "quadratic")
    assert design.proved
    assert design.region == region
    assert tightest_of(oscillator, -5, "quadratic").proved


def test_simulations_and_comparisons_say_so(sharpest, tmp_path):
    design = sharpest["platform at -1"]
    path = design.save(tmp_path / "law")
    assert "does NOT keep" in read_law(design.plant, str(path)).proved
    runs = tightest_of(design.plant, -1.0)
    assert "NOT" not in read_law(design.plant, str(runs.save(tmp_path / "runs"))).proved


def test_rounding_counts_in_units_of_the_room(oscillator):
    """One state, A + K = -2 + d in the disk(-2, r): F = [r, -d; -d, r]; K is off by UNIT |K|."""
    plant = UncertainPlant.from_vertices([[[3.0]]], [[[1.0]]])
    for d, r in ((0.0, 0.5), (0.25, 0.5), (-0.25, 0.375)):
        K = d - 5.0
        certificate = Certificate(
            plant, Disk(-2, r), "quadratic", FixedGain([[K]]), {"W": np.array([[7.0]])}
        )
        assert certificate.prove().proved
        size = Disk(-2, r).size
        room = r + TOLERANCE * size
        expected = 2 * SAFETY * UNIT * abs(K) * room / (room**2 - d**2)
        assert rounding_share(certificate) == pytest.approx(expected, rel=1e-12)
    half = Certificate(
        plant, HalfPlane(1), "quadratic", FixedGain([[-5.0]]), {"W": np.array([[7.0]])}
    )
    # 2 (a - 2) of the LMI is 2: twice the distance, of which twice the error is taken
    expected = SAFETY * UNIT * 2 * 5 / (2 + TOLERANCE * HalfPlane(1).size)
    assert rounding_share(half) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("k", [1e3, 1e10, 1e18])
def test_errors_where_the_loop_is_fast_take_little(k):
    """Poles at -1 and about -k, K = [-k, -k]: errors of K are large, and harm nothing slow."""
    plant = UncertainPlant.from_vertices([[[0.0, 1.0], [0.0, 0.0]]], [[[0.0], [1.0]]])
    W = np.array([[1.0, -1.0], [-1.0, 2.0]])
    fast = Certificate(plant, HalfPlane(0.5), "quadratic", FixedGain([[-k, -k]]), {"W": W})
    assert fast.prove().proved
    assert 0 < rounding_share(fast) < 1e-3
    # the same gains, the certificate that of another region: no room at all
    assert rounding_share(replace(fast, region=HalfPlane(1.5))) == np.inf


def test_points_that_are_judged_lie_in_the_family():
    for domain in (Domain((3,)), Domain((2, 2)), Domain((1,)), Domain((2, 2, 2))):
        found = _places(domain)
        assert np.allclose(found.sum(axis=1), 1)
        assert found.min() >= 0
        assert np.array_equal(found[: domain.corners], np.eye(domain.corners))
        marginals = domain.coordinates(found)
        assert np.allclose(domain.alpha(marginals), found)


# --- coordinates ---------------------------------------------------------------------------------


@pytest.mark.parametrize("decades", [0, 8, 16, 22])
def test_coordinates_whiten_what_doubles_call_singular(decades):
    random = np.random.default_rng(decades)
    Q, _ = np.linalg.qr(random.normal(size=(5, 5)))
    half = Q * np.logspace(0, -decades / 2, 5)
    # a little more than the product of doubles, so that it is positive definite
    W = half @ half.T
    W = np.where(np.eye(5) > 0, np.nextafter(np.nextafter(W, 2), 2), (W + W.T) / 2)
    W = np.tril(W) + np.tril(W, -1).T
    found = Coordinates.whitening(W)
    if found is None:  # rounded to an indefinite matrix: exact arithmetic agrees
        whole = [[int(Fraction(float(e)) * 2**200) for e in row] for row in W]
        assert not definite.is_positive_definite(whole)
        return
    assert np.allclose(found.forms(W[None])[0], np.eye(5), atol=1e-6)
    K = random.normal(size=(1, 2, 5))
    A = random.normal(size=(1, 5, 5))
    # T A T^-1 T W T' is T A W T', exactly but for the last rounding
    T = [[Fraction(float(e)) for e in row] for row in found.T]

    def product(*matrices):
        total = matrices[0]
        for M in matrices[1:]:
            columns = list(zip(*M, strict=True))
            total = [
                [sum(a * b for a, b in zip(r, c, strict=True)) for c in columns] for r in total
            ]
        return total

    def transposed(M):
        return [list(column) for column in zip(*M, strict=True)]

    w, a, k = rationals(W), rationals(A[0]), rationals(K[0])
    assert np.array_equal(
        found.forms(W[None])[0], np.array(product(T, w, transposed(T)), dtype=float)
    )
    assert np.array_equal(found.gains(K)[0], np.array(product(k, transposed(T)), dtype=float))
    assert np.array_equal(found.inputs(A)[0], np.array(product(T, a), dtype=float))
    back = transposed(exactly.right_divide(_eye(5), transposed(T)))
    assert np.allclose(found.inverse, np.array(back, dtype=float), rtol=1e-15, atol=0)
    pairs = (
        (found.loops(A)[0], product(T, a, back)),
        (found.feedback(K)[0], product(k, back)),
        (found.duals(A)[0], product(transposed(back), a, back)),
    )
    for mine, other in pairs:
        assert np.allclose(mine, np.array(other, dtype=float), rtol=1e-15, atol=0)


def _eye(n):
    return [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]


def test_what_has_no_coordinates():
    assert Coordinates.whitening(np.array([[1.0, 2.0], [2.0, 1.0]])) is None
    assert Coordinates.whitening(np.zeros((2, 2))) is None
    far = Coordinates(np.diag([1e200, 1.0]))
    assert np.isinf(far.forms(np.array([[[1.0, 0.0], [0.0, 1.0]]]))[0, 0, 0])
    # a law that was given, W not positive definite: evaluated all the same
    law = ScheduledGain([[[1.0, 2.0], [2.0, 1.0]]] * 2, [[[1.0, 0.0]], [[0.0, 1.0]]])
    assert not law.coordinates.whitens
    K = law.gain([0.25, 0.75])
    assert np.allclose(K @ law.W[0], [[0.25, 0.75]])


def test_laws_travel_between_processes(sharpest):
    import pickle

    design = sharpest["helicopter at -3"]
    again = pickle.loads(pickle.dumps(design))
    assert isinstance(again, Design)
    assert again.rounding == design.rounding
    alpha = [0.25, 0.75]
    assert np.array_equal(again.law.gain(alpha), design.law.gain(alpha))
