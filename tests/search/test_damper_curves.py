"""Dampers that give forces between two measured curves: limits, the law, files, drives and code."""

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import InputError, semi_active
from polefence.certify.refutation import lowest
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.export.damper import damper_sources
from polefence.plant.dampers import Damper
from polefence.plant.spec import loads as loads_spec
from polefence.proof import squares
from polefence.proof.claims.base import prove
from polefence.proof.dampers import Curve
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.work import FormatError
from polefence.requirements.rms import Rms
from polefence.vehicle import Hardware, drive, on_road, random_road, velocity_density
from support.commands import ran, refused
from support.needed import need
from support.shapes_of_laws import STRICT, run

DENSITY = velocity_density("C", 20)
LOW = [[-1, -350], [-0.1, -50], [0, 0], [0.1, 80], [1, 600]]
HIGH = [[-1, -1800], [-0.1, -600], [0, 0], [0.1, 900], [1, 3000]]
NAMES = ("damper force", "suspension deflection")
DAMPER = Damper(*NAMES, *([[str(v), F] for v, F in own] for own in (LOW, HIGH)))
SIGNALS = ["sprung-mass acceleration", "tyre share"]
SPEC = re.sub("range = .300, 3000.*", f"low = {LOW}\nhigh = {HIGH}", spec_text("semi-active"))


def curve(points, v):
    """Piecewise linear, from numbers alone, going on beyond the ends as it ended."""
    (a, F), (b, G), (c, H), (d, K) = (*points[:2], *points[-2:])
    v0, F0 = np.array(points, float).T
    below, above = F + (G - F) / (b - a) * (v - a), K + (K - H) / (d - c) * (v - d)
    return np.where(v < a, below, np.where(v > d, above, np.interp(v, v0, F0)))


def clipped(u, v):
    ends = curve(LOW, v), curve(HIGH, v)
    return np.clip(u, np.minimum(*ends), np.maximum(*ends))


@pytest.fixture(scope="module")
def plant():
    return loads_spec(SPEC)


@pytest.fixture(scope="module")
def law(plant):
    return semi_active(plant, Rms(SIGNALS, 1.0, DENSITY), [DAMPER], 4)


# --- curves --------------------------------------------------------------------------------------


def test_a_curve_is_what_its_points_say():
    for points in (LOW, HIGH, [[-1, -700], [0, 0], [2, 500]], [[-1, -5], [1, 5]]):
        own = Damper(*NAMES, points, [[-1, -9000], [1, 9000]]).low
        v = np.linspace(-3, 3, 601)
        values = np.array([float(own.at(Fraction(x))) for x in v])
        assert values == pytest.approx(curve(points, v), rel=1e-12, abs=1e-9)
        ratios = values[v != 0] / v[v != 0]
        least, most = map(float, own.ratios)
        assert least <= ratios.min() + 1e-9
        assert ratios.max() <= most + 1e-9
        far = curve(points, np.array([-1e9, -1e-9, 1e-9, 1e9])) / [-1e9, -1e-9, 1e-9, 1e9]
        assert (least, most) == pytest.approx((min(*ratios, *far), max(*ratios, *far)), rel=1e-6)


def test_parts_are_where_both_are_lines(plant):
    own = DAMPER.of(plant)
    assert [end for _, end in own.parts[:-1]] == pytest.approx([-0.1, 0, 0.1])
    assert not own.straight
    for part, v in zip(own.parts, (-5, -0.05, 0.05, 7), strict=True):
        for (slope, start), points in zip(own.lines(part), (LOW, HIGH), strict=True):
            assert float(slope * v + start) == pytest.approx(float(curve(points, np.array(v))))
    assert Damper(*NAMES, 300, 3000).of(plant).straight
    assert Damper(*NAMES, [[-1, -300], [0, 0], [2, 600]], 3000).of(plant).straight


def test_points_of_one_side_are_mirrored():
    assert Damper(*NAMES, [[0.1, 50], [1, 200]], 4000).low == Curve(
        tuple((Fraction(v), Fraction(F)) for v, F in
              ((-1, -200), (-0.1, -50), (0, 0), (0.1, 50), (1, 200)))
    )  # fmt: skip


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        ([[0, 0], [1, -300]], 3000, "must be zero or more, and low below high"),
        (3000, [[0.1, 900], [1, 2000]], "low below high, in size, at every rate, also beyond"),
        ([[-1, -300], [1, 301]], 3000, "low: point 1|low"),
        ([[-1, -300], [-1, -200], [1, 300]], 3000, "low: rates must ascend"),
        ([[-1, -300], [0, 10], [1, 300]], 3000, "low: it must be zero where the rate is"),
        ([[1, 2, 3]], 3000, r"low: point 1 must be \[rate in m/s, force in N\]"),
        (300, [["x", 2]], "high: point 1 = "),
        (300, [[k, 3000 * k] for k in range(1, 50)], "high has 99 points; at most 40"),
    ],
)
def test_curves_that_are_none_are_refused(low, high, words):
    if words.startswith("low: point 1|"):  # zero is between the points: it is put there
        assert Damper(*NAMES, low, high).low.at(Fraction(0)) == 0
        return
    with pytest.raises(InputError, match=words):
        Damper(*NAMES, low, high)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("high = ", "range = [1, 2]\nhigh = ", "write range = [300, 3000], or low and high"),
        (f"high = {HIGH}", "", "write range = [300, 3000], or low and high"),
        (f"high = {HIGH}", "high = 3", "high = 3 must be points, [[RATE, FORCE], ...]"),
        ("[1, 3000]", "[1]", "high: point 5 must be [RATE in m/s, FORCE in N]"),
        ("[1, 3000]", '[1, "a"]', "high: point 5 = 'a' must be a finite number"),
    ],
)
def test_a_spec_that_says_it_wrongly_is_refused(tmp_path, capsys, old, new, words):
    path = tmp_path / "wrong.toml"
    path.write_text(SPEC.replace(old, new, 1))
    said = refused(capsys, "semi-active", path)
    assert words in said
    assert "damper.'damper force'" in said or 'damper."damper force"' in said


# --- limits --------------------------------------------------------------------------------------


def test_both_limits_enclose_hostile_drives(plant, law):
    """Loads, and starts of the noise, that are drawn; the law of the claim in floats."""
    floor = lowest(plant, law.specification, law.passive, [DAMPER])[1]
    assert floor < law.level
    claim, source = law.claim, np.random.default_rng(4)
    rate, K = np.array([0.0, 0, -1, 1]), np.array(claim.K[0], float)
    step, roads = 1e-3, 300
    size = np.array(claim.E[0], float)[:, 0] * np.sqrt(DENSITY / 4 * step)
    alphas = [np.eye(2)[0], np.eye(2)[1], *source.dirichlet((1, 1), 2)]
    found = []
    for alpha in alphas:
        A, B = (np.tensordot(alpha, np.array(M, float), 1) for M in (claim.A, claim.B))
        x, total, steps = np.zeros((roads, 4)), 0.0, 6000

        def moved(x, A=A, B=B):
            return x @ A.T + clipped(x @ K, x @ rate)[:, None] * B[:, 0]

        for k in range(steps):
            x = x + source.standard_normal((roads, 1)) * size
            x = x + step * moved(x + step / 2 * moved(x))
            x = x + source.standard_normal((roads, 1)) * size
            if k >= 2000:
                total += np.mean(moved(x)[:, 2] ** 2 + (100 * x[:, 1]) ** 2)
        found.append(np.sqrt(total / (steps - 2000)))
    # of 300 roads of 4 s the error is about 0.7 %
    assert max(found) < law.level * 1.01
    assert max(found) > floor


def test_the_mean_falls_at_random_points(law):
    claim, source = law.claim, np.random.default_rng(8)
    n, units = 4, np.array(claim.units, float)
    powers = np.array(squares.known(n, claim.degree, claim.even)[1:])
    assert not claim.even
    noise = np.array(claim.E[0], float)[:, 0] * float(claim.limit.intensity) ** 0.5 / units
    A, B, V = (np.array(M, float) for M in (claim.A, claim.B, claim.V))
    rate, K = np.array([0.0, 0, -1, 1]), np.array(claim.K[0], float)
    for _ in range(300):
        alpha = source.dirichlet((0.6, 0.6))
        A1, B1, V1 = (np.tensordot(alpha, M, 1) for M in (A, B, V))
        xi = source.standard_normal(n) * 10 ** source.uniform(-1.5, 0.8)
        x = units * xi
        u = clipped(K @ x, rate @ x)
        moved = A1 @ x + B1[:, 0] * u

        def at(point, V1=V1):
            return V1 @ np.prod(point**powers, axis=1)

        h = 1e-4 / (1 + np.abs(xi).max())
        along = moved / units / (1 + np.abs(moved / units).max())
        drift = (at(xi + h * along) - at(xi - h * along)) / (2 * h)
        drift *= 1 + np.abs(moved / units).max()
        unit = noise / np.linalg.norm(noise)
        bent = (at(xi + h * unit) + at(xi - h * unit) - 2 * at(xi)) / h**2
        drift += bent * np.linalg.norm(noise) ** 2 / 2
        z = moved[2] ** 2 + (100 * x[1]) ** 2
        left = 1 - z / float(claim.limit.level) ** 2 - drift
        assert left > -1e-3 * (1 + abs(drift))


def test_the_growth_of_any_logic_is_negative(law):
    claim = law.claim
    A, B, X = (np.array(M, float) for M in (claim.A, claim.B, claim.X))
    S, rate = np.diag(np.array(claim.units, float)), np.array([[0.0, 0, -1, 1]])
    for t in np.linspace(0, 1, 5):
        A1, B1, X1 = ((1 - t) * M[0] + t * M[1] for M in (A, B, X))
        for c in np.linspace(*map(float, claim.dampers[0].ends), 20):
            XA = X1 @ (A1 + c * B1 @ rate)
            assert np.linalg.eigvalsh(S @ (XA + XA.T) @ S)[-1] < 0


def test_each_fault_in_a_curve_is_found(plant, law):
    claim = law.claim
    (damper,) = claim.dampers
    assert prove(claim).proved
    assert check(read(law.file().dumps())).proved
    for key in ("low", "high"):
        points = getattr(damper, key).points
        for k, (v, F) in enumerate(points):
            if not v:
                continue
            # outside the curve that was proved, by much: softer below, harder above
            other = F * Fraction("0.4" if key == "low" else "2.5")
            changed = Curve((*points[:k], (v, other), *points[k + 1 :]))
            wrong = replace(claim, dampers=(replace(damper, **{key: changed}),))
            assert not prove(wrong).proved, (key, k)
    swapped = [claim.pieces[3:] + claim.pieces[:3], claim.pieces[::-1]]
    for pieces in swapped:
        assert not proved(replace(claim, pieces=pieces))
    straight = replace(damper, low=Curve.line(Fraction(300)), high=Curve.line(Fraction(9000)))
    for wrong, words in (
        (straight, "V must hold|pieces must be"),
        (replace(damper, low=damper.high, high=damper.low), "low must not be above high"),
        (replace(damper, low=Curve(damper.low.points[::-1])), "rates must ascend"),
        (replace(damper, low=Curve(damper.low.points[:1])), "rates must ascend"),
        (replace(damper, high=Curve(damper.high.points * 9)), "at most 40 points"),
        (replace(damper, low=Curve(((Fraction(-1), Fraction(-1)), (Fraction(1), Fraction(2))))),
         "it must be zero where the rate is"),
    ):  # fmt: skip
        with pytest.raises(FormatError, match=words):
            prove(replace(claim, dampers=(wrong,)))


def proved(claim):
    try:
        return prove(claim).proved
    except FormatError:
        return False


def test_a_bent_limit_with_other_curves_proves_nothing(plant, law):
    claim = lowest(plant, law.specification, law.passive, [DAMPER])[0].claim
    (damper,) = claim.dampers
    wider = Damper(*NAMES, [[str(v), F / 2] for v, F in LOW], HIGH).of(plant)
    assert prove(claim).proved
    assert not prove(replace(claim, dampers=(replace(damper, low=wider.low),))).proved


# --- files, drives and code ----------------------------------------------------------------------


def test_the_file_is_checked_against_the_spec(law, tmp_path, capsys):
    (tmp_path / "damper.toml").write_text(SPEC)
    path = law.save(tmp_path)
    said = ran(capsys, "check", path, "--spec", tmp_path / "damper.toml")
    assert "clipped to the line by (-1, -350) " in said
    (tmp_path / "other.toml").write_text(SPEC.replace("[1, 3000]", "[1, 3100]"))
    assert main(["check", str(path), "--spec", str(tmp_path / "other.toml")]) != 0
    said = capsys.readouterr()
    assert "other dampers" in said.out + said.err


def test_drives_keep_to_the_curves_with_and_without_the_kernel(plant, law, monkeypatch):
    moved = on_road(plant, random_road("D", 60, seed=3), 20.0, 1e-3)
    words = (plant, law.K, moved, None, Hardware(dampers=(DAMPER,)))
    fast = drive(*words)
    monkeypatch.setattr("polefence.vehicle.driving.drive.compiled", lambda: None)
    slow = drive(*words)
    names = ["sprung-mass velocity", "unsprung-mass velocity", "damper force"]
    for one in (fast, slow):
        body, wheel, force = np.moveaxis(one.response(names).values, 2, 0)
        v = wheel - body
        assert np.abs(v).max() > 0.3
        asked = one.states[..., :4] @ law.K[0]
        assert force == pytest.approx(clipped(asked, v), rel=1e-9, abs=1e-6)
    assert fast.states == pytest.approx(slow.states, rel=1e-6, abs=1e-9)


def test_the_code_keeps_to_the_curves(law, tmp_path):
    import ctypes

    for name, text in damper_sources(law.file(), 64).items():
        (tmp_path / name).write_bytes(text)
    made = run(need("gcc"), *STRICT, "-shared", "-fPIC", tmp_path / "law.c", "-o", tmp_path / "x")
    assert not made.stderr
    update = ctypes.CDLL(str(tmp_path / "x")).law_update
    source = np.random.default_rng(2)
    for _ in range(1000):
        x = source.standard_normal(4) * [0.02, 0.005, 0.3, 0.6] * 10 ** source.uniform(-3, 1)
        c = np.full(1, np.nan)
        assert update(x.ctypes.data_as(ctypes.c_void_p), c.ctypes.data_as(ctypes.c_void_p)) == 0
        v = x[3] - x[2]
        assert c[0] * v == pytest.approx(float(clipped(law.K[0] @ x, v)), rel=1e-9)
    for x in ([0.0, 0, 0, 0], [1.0, 0, 0, 1e-310], [np.nan, 0, 0, 0], [0, 0, 1e308, -1e308]):
        update(np.array(x).ctypes.data_as(ctypes.c_void_p), c.ctypes.data_as(ctypes.c_void_p))
        assert 1000 / 3 - 1e-9 <= c[0] <= 9000


def test_the_command_says_both_limits(tmp_path, capsys):
    (tmp_path / "damper.toml").write_text(SPEC)
    assert main(["semi-active", str(tmp_path / "damper.toml"), "--degree", "4"]) == 0
    out = capsys.readouterr().out
    assert "by a polynomial of degree 4" in out
    assert "no semi-active law goes below 0.865" in out
