"""What no law's gain goes below: closed forms, Riccati equations, laws that exceed it, faults."""

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import block_diag

from polefence import Gain, Rms, Structure, UncertainPlant, check, load, optimise
from polefence.certify.refutation import least_of_any, refute_limits
from polefence.cli.main import main
from polefence.examples import spec_path
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from polefence.requirements.text import load_specifications
from polefence.response.samples import at_sample_time
from polefence.search.optimise import limit_of_any_law
from support.specs import ONE_STATE, TWO_STATES

BOTH = ("x", "force")


@pytest.fixture(scope="module")
def one():
    return loads(ONE_STATE)


def level(found):
    return found.specifications[0].at_most


def vertex(A, B, E):
    return UncertainPlant.from_vertices([A], [B], [E])


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("a", [-3.0, -1.0, -0.1, 0.5, 2.0])
def test_one_state_and_its_force(a):
    # k P^2 + 2 a P + 1 = 0 with k = 1/g^2 - 1 has a positive P from 1/g^2 = 1 + a^2 on; of an
    # unstable state from g = 1 on
    least = 1 / math.sqrt(1 + a**2) if a < 0 else 1.0
    found = least_of_any(vertex([[a]], [[1.0]], [[1.0]]), Gain(("x1", "u1")), (), 3.0)
    assert prove(found.claim).proved
    assert least * (1 - 1e-5) < level(found) <= least * (1 + 1e-12)


def test_what_holding_an_unstable_state_takes(one):
    # s = a is a zero of the loop from w to x, and -1 is what the force does about w there
    found = least_of_any(one, Gain("force"), (), 5.0)
    assert 1 - 1e-5 < level(found) <= 1


@pytest.mark.parametrize("through", [0.0, 1.5])
def test_a_zero_in_the_right_half_plane_is_an_interpolation(through):
    # 1/(s + 1) - 1.5/(s + 2) has its zero at s = 1, where no input changes what w does
    A, B, E = np.diag([-1.0, -2.0]), np.ones((2, 1)), np.array([[5.0], [1.0]])
    y = Output("y", C=[1, -1.5], F=[through] if through else ())
    least = abs(5 / 2 - 1.5 * 1 / 3 + through)
    found = least_of_any(vertex(A, B, E), Gain(y), (), 10.0)
    assert least * (1 - 1e-5) < level(found) <= least * (1 + 1e-12)


def test_a_wheel_on_an_undamped_tyre_moves_the_body_at_its_own_frequency():
    # 240 kg of body, 60 of wheel, 190 kN/m: m_b a = k z_r there, whatever the force between them
    plant = load(spec_path("active-suspension"))
    found = least_of_any(plant, Gain("body acceleration"), (), 20.0)
    least = 190e3 / 240 / math.sqrt(190e3 / 60)
    assert prove(found.claim).proved
    assert least * (1 - 1e-6) < level(found) <= least * (1 + 1e-12)
    assert least == pytest.approx(14.07, rel=1e-3)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_of_several_frequencies_it_is_the_largest(count):
    # x_i'' = -w_i^2 x_i + u + e_i w: u = -e_i w at w_i, or x_i grows
    rates = [1.5, 2.0, 3.1][:count]
    A = block_diag(*(np.array([[0.0, 1.0], [-(w**2), 0.0]]) for w in rates))
    B = np.tile([[0.0], [1.0]], (count, 1))
    E = np.concatenate([[[0.0], [e]] for e in (0.3, -2.0, 1.0)[:count]])
    found = least_of_any(vertex(A, B, E), Gain("u1"), (), 5.0)
    least = max(0.3, 2.0 if count > 1 else 0.0)
    assert prove(found.claim).proved
    assert least * (1 - 1e-4) < level(found) <= least * (1 + 1e-12)


def test_where_some_law_has_next_to_nothing_there_is_no_limit(one):
    assert least_of_any(one, Gain("x"), (), 1.0) is None


# --- random plants, against a Riccati equation ----------------------------------------------------


def keeps(g, A, B, E, C, D):
    """Whether the equation of the game has a solution that is positive and stabilises."""
    n, q = len(A), E.shape[1]
    R = block_diag(D.T @ D, -(g**2) * np.eye(q))
    S = np.hstack([C.T @ D, np.zeros((n, q))])
    both = np.hstack([B, E])
    H = np.block([[A, np.zeros((n, n))], [-C.T @ C, -A.T]])
    H = H - np.vstack([both, -S]) @ np.linalg.solve(R, np.hstack([S.T, both.T]))
    values, vectors = np.linalg.eig(H)
    stable = vectors[:, values.real < 0]
    if np.abs(values.real).min() < 1e-9 * np.abs(values).max() or stable.shape[1] != n:
        return False
    P = (stable[n:] @ np.linalg.inv(stable[:n])).real
    return np.linalg.eigvalsh((P + P.T) / 2).min() >= -1e-9 * np.abs(P).max()


def best_of(*plant):
    low, high = 1e-6, 1e6
    for _ in range(60):
        g = math.sqrt(low * high)
        low, high = (low, g) if keeps(g, *plant) else (g, high)
    return high


def of_random(random):
    n, m, q = random.integers(2, 9), random.integers(1, 3), random.integers(1, 3)
    A, B, E = (random.integers(-3, 4, s).astype(float) for s in ((n, n), (n, m), (n, q)))
    C = np.vstack([random.integers(-2, 3, (2, n)), np.zeros((m, n))]).astype(float)
    D = np.vstack([np.zeros((2, m)), np.eye(m)])
    return A, B, E, C, D


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_best_of_a_random_plant(seed):
    A, B, E, C, D = of_random(np.random.default_rng(seed))
    signals = tuple(Output(f"y{i}", C=C[i], D=D[i]) for i in range(len(C)))
    least = best_of(A, B, E, C, D)
    found = least_of_any(vertex(A, B, E), Gain(signals), (), 2 * least)
    assert prove(found.claim).proved
    assert least * (1 - 1e-4) < level(found) <= least * (1 + 1e-7)


def test_of_several_vertices_it_is_that_of_the_worst(one):
    found = least_of_any(loads(ONE_STATE.replace("[0.5, 2]", "[-3, -1]")), Gain(BOTH), (), 1.0)
    assert found.vertex == 1  # a = -1
    assert level(found) == pytest.approx(math.sqrt(0.5), rel=1e-5)


# --- limits on other gains ------------------------------------------------------------------------


def test_a_tighter_limit_raises_it(one):
    plant = loads(ONE_STATE.replace("[0.5, 2]", "[-3, -1]"))
    limits = [0.8, 0.5, 0.2]
    found = [least_of_any(plant, Gain("x"), [Gain("force", c)], 1.0) for c in limits]
    levels = [level(one) for one in found]
    assert levels == sorted(levels)
    assert all(prove(one.claim).proved for one in found)
    for c, least in zip(limits, levels, strict=True):
        # u = -k x has 1/(1 + k) and k/(1 + k)
        assert least <= 1 - c
    # s = 0: x = u + w there, and no more of w than c is taken off
    assert levels[-1] > 0


def test_of_one_signal_twice_it_is_the_limit_that_is_tighter(one):
    # the gain of the vector is what no law has below 1 and its first entry is not 0
    plant = loads(ONE_STATE.replace("[0.5, 2]", "[-3, -1]"))
    whole = level(least_of_any(plant, Gain(BOTH), (), 1.0))
    found = least_of_any(plant, Gain("x"), [Gain("force", whole)], 1.0)
    assert level(found) < whole


def test_limits_from_other_disturbances_and_of_other_kinds_are_left_out():
    plant = loads(TWO_STATES)
    asked = Gain(("x", "force"))
    alone = level(least_of_any(plant, asked, (), 1.0))
    others = [Rms("force", 1.0, 2.0), Gain("v", 0.1, disturbances=[("w", 0.5)])]
    assert level(least_of_any(plant, asked, others, 1.0)) == alone


def test_half_of_the_disturbance_has_half_the_gain():
    plant, asked = loads(TWO_STATES), Gain(("x", "force"))
    whole = level(least_of_any(plant, asked, (), 1.0))
    half = level(least_of_any(plant, replace(asked, disturbances=[("w", 0.5)]), (), 1.0))
    assert half == pytest.approx(whole / 2, rel=1e-5)


# --- laws that exceed it --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "structure",
    [None, Structure(("x",), schedule=(), order=1), Structure(("x",), schedule=())],
)
def test_laws_exceed_it(structure):
    plant = loads(ONE_STATE.replace("[0.5, 2]", "[-3, -1]"))
    done = optimise(plant, Gain(BOTH), structure=structure)
    assert done.limit_of_any_law.specifications[0].name == done.bounds[0].specification.name
    assert 1.0 < done.bounds[0].level / level(done.limit_of_any_law) < 2.0


def test_at_samples_it_is_that_of_the_plant_itself():
    plant, asked = loads(TWO_STATES), Gain(("x", "force"))
    found = limit_of_any_law(at_sample_time(plant, Fraction(1, 20)), asked, (), 1.0)
    assert found.plant.sample_time is None
    assert level(found) == level(least_of_any(plant, asked, (), 1.0))


def test_of_a_plant_with_hardware_it_is_below_what_is_proved_of_its_best_laws():
    path = spec_path("active-suspension")
    plant, least, limits = load(path), *load_specifications(path)
    found = least_of_any(plant, least, limits, 0.0749)
    assert prove(found.claim).proved
    assert 0.0548 < level(found) < 0.0749  # of order 4


# --- what is left out -----------------------------------------------------------------------------


def test_other_kinds_and_other_plants_have_none(one):
    assert least_of_any(one, Gain(BOTH, at="samples"), (), 1.0) is None
    discrete = UncertainPlant.from_vertices([[[0.5]]], [[[1.0]]], [[[1.0]]], sample_time=1)
    assert least_of_any(discrete, Gain(("x1", "u1")), (), 1.0) is None


# --- faults, one at a time ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def claim():
    plant = loads(ONE_STATE.replace("[0.5, 2]", "[-3, -1]"))
    return least_of_any(plant, Gain("x"), [Gain("force", 0.3)], 1.0).claim


@pytest.mark.parametrize("which", [0, 1])
def test_a_level_that_some_law_may_keep_is_not_proved(claim, which):
    for share, proved in ((0.99, True), (1.0, True), (1.0001, False), (2.0, False)):
        limits = list(claim.limits)
        limits[which] = replace(limits[which], level=limits[which].level * Fraction(share))
        assert prove(replace(claim, limits=tuple(limits))).proved is proved


@pytest.mark.parametrize("place", [(0, 0), (0, 1), (1, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize("share", [0, -1, 0.999, 1.001])
def test_another_matrix_is_not_proved(claim, place, share):
    i, j = place
    if not claim.Z[i][j]:
        return
    Z = [list(row) for row in claim.Z]
    Z[i][j] = Z[j][i] = Z[i][j] * Fraction(share)
    assert not prove(replace(claim, Z=Z)).proved


def test_a_matrix_that_is_no_square_or_not_symmetric_is_not_proved(claim):
    assert not prove(replace(claim, Z=[[-x for x in row] for row in claim.Z])).proved
    Z = [list(row) for row in claim.Z]
    Z[0][1] += 1
    assert prove(replace(claim, Z=Z)).reason == "Z is not symmetric"
    with pytest.raises(FormatError, match="Z"):
        prove(replace(claim, Z=Z[:-1]))


def test_the_size_of_the_matrix_does_not_matter(claim):
    assert prove(replace(claim, Z=[[3 * x for x in row] for row in claim.Z])).proved


def test_shares_are_positive_and_of_sum_one_or_less(claim):
    first, second = claim.shares
    for shares in (
        (first + 1, second),
        (-first, second),
        (Fraction(0), second),
        (first, 1 - first),
    ):
        verdict = prove(replace(claim, shares=shares))
        assert verdict.proved is (shares == (first, 1 - first))
    with pytest.raises(FormatError, match="share"):
        prove(replace(claim, shares=(first,)))


def test_another_plant_is_not_proved(claim):
    j = claim.vertex
    for name, change in (("A", -1), ("B", 1), ("E", Fraction(-1, 100))):
        matrices = [[list(row) for row in M] for M in getattr(claim, name)]
        matrices[j][0][0] += change
        assert not prove(replace(claim, **{name: matrices})).proved
    assert not prove(replace(claim, vertex=0)).proved
    for outside in (2, -1):
        with pytest.raises(FormatError, match="vertex"):
            prove(replace(claim, vertex=outside))


def test_less_of_the_disturbance_is_not_proved(claim):
    assert prove(replace(claim, scales=(Fraction(1),))).proved
    assert not prove(replace(claim, scales=(Fraction(99, 100),))).proved


# --- the command ----------------------------------------------------------------------------------


def test_the_command_prints_writes_and_checks_it(tmp_path, capsys):
    spec = tmp_path / "two.toml"
    asked = '[[specification]]\nkind = "gain"\nsignal = ["x", "force"]\nminimise = true\n'
    spec.write_text(TWO_STATES + asked)
    out, summary = tmp_path / "out", tmp_path / "summary.json"
    assert main(["optimise", str(spec), "-o", str(out), "--json", str(summary)]) == 0
    assert "no law, of any order and whatever it measures, goes below" in capsys.readouterr().out
    told = json.loads(summary.read_text())["limit_of_any_law"]
    proved = json.loads(summary.read_text())["bounds"][0]["proved"]
    assert 0.5 * proved < told["least"] < proved
    assert check(out / "limit.json").proved
    assert main(["check", str(out), "--spec", str(spec)]) == 0
    assert "no law keeps gain of ['x' = x1, 'force' = u1] <=" in capsys.readouterr().out
    file = json.loads((out / "limit.json").read_text())
    limit = file["claims"][0]["limits"][0]
    limit["level"] = str(Fraction(limit["level"]) * Fraction(1001, 1000))
    (out / "limit.json").write_text(json.dumps(file))
    assert main(["check", str(out)]) == 1


# --- limits in conflict ---------------------------------------------------------------------------


def test_limits_that_no_law_keeps_are_refuted(one):
    plant = loads(ONE_STATE.replace("[0.5, 2]", "[-3, -1]"))
    # at s = 0 and a = -1: x = u + w
    found = refute_limits(plant, [Gain("x", 0.2), Gain("force", 0.3)])
    assert found.vertex == 1
    assert 1.5 < found.factor <= 2.0
    assert prove(found.claim).proved
    for share, proved in ((0.99, True), (1.001, False)):
        changed = replace(found.claim, factor=found.claim.factor * Fraction(share))
        assert prove(changed).proved is proved
    with pytest.raises(FormatError, match="factor"):
        prove(replace(found.claim, factor=Fraction(1, 2)))
    assert refute_limits(plant, [Gain("x", 0.6), Gain("force", 0.5)]) is None


@pytest.mark.parametrize("seed", range(6))
def test_the_factor_of_one_limit_is_what_the_best_law_has(seed):
    A, B, E, C, D = of_random(np.random.default_rng(seed))
    signals = tuple(Output(f"y{i}", C=C[i], D=D[i]) for i in range(len(C)))
    least = best_of(A, B, E, C, D)
    found = refute_limits(vertex(A, B, E), [Gain(signals, least / 3)])
    assert 3 * (1 - 1e-4) < found.factor <= 3 * (1 + 1e-7)
    assert refute_limits(vertex(A, B, E), [Gain(signals, 1.001 * least)]) is None


def test_the_command_says_that_no_law_keeps_them(tmp_path, capsys):
    spec = tmp_path / "two.toml"
    spec.write_text(TWO_STATES)
    words = ["--minimise", "gain of v", "--limit", "gain of [x, force] <= 0.1"]
    assert main(["optimise", str(spec), *words]) == 1
    assert "refuted: at vertex" in "".join(capsys.readouterr())
