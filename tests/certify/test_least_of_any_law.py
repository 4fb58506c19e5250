"""What no law goes below: closed forms, regulators that attain it, laws that exceed it, faults.

Within limits that a regulator's own values are, for weights that are all positive, that regulator
is the best of all laws: its weights are the multipliers.
"""

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from polefence import Rms, Structure, UncertainPlant, check, load, optimise
from polefence.certify.refutation import least_of_any
from polefence.cli.main import main
from polefence.examples import spec_path
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.claims.refutation import RmsLimit, require_limit
from polefence.proof.work import FormatError
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.text import load_specifications
from polefence.response.samples import at_sample_time
from support.specs import MASS_ON_SPRING, ONE_STATE

FORCE = 5.0


@pytest.fixture(scope="module")
def one():
    return loads(ONE_STATE)


def level(found):
    return found.specifications[0].at_most


# --- closed form: u = -k x has mean squares x^2 = 1 / (2 (k - a)), u^2 = k^2 x^2 ------------------


def test_the_level_of_one_state_is_the_closed_form(one):
    a = 2.0  # the largest k with k^2 / (2 (k - a)) = force^2
    k = FORCE**2 + math.sqrt(FORCE**4 - 2 * FORCE**2 * a)
    least = math.sqrt(1 / (2 * (k - a)))
    found = least_of_any(one, Rms("x", None, 2.0), [Rms("force", FORCE, 2.0)], 1.0)
    assert found.vertex == 1
    assert least * (1 - 1e-5) < level(found) <= least
    assert [s.title for s in found.specifications] == ["rms of x", "rms of force"]


def test_it_does_not_depend_on_what_some_law_keeps(one):
    asked = one, Rms("x", None, 2.0), [Rms("force", FORCE, 2.0)]
    levels = [level(least_of_any(*asked, near)) for near in (0.11, 1.0, 1e2)]
    assert levels == pytest.approx([levels[0]] * 3, rel=1e-5)


def test_without_limits_it_is_what_holding_the_plant_takes(one):
    # an unstable state a takes a mean square of 2 a, whatever the law
    found = least_of_any(one, Rms("force", None, 2.0), (), 5.0)
    assert 2 * (1 - 1e-5) < level(found) <= 2
    assert found.specifications[1:] == ()


def test_each_limit_has_its_own_noise(one):
    same = least_of_any(one, Rms("x", None, 8.0), [Rms("force", FORCE / 10, 0.02)], 1.0)
    own = least_of_any(one, Rms("x", None, 2.0), [Rms("force", FORCE, 2.0)], 1.0)
    assert level(same) == pytest.approx(2 * level(own), rel=1e-5)


# --- random plants, where the best law is known ---------------------------------------------------


def regulated(random):
    """A plant of one vertex, signals, and the values of a regulator that is the best law."""
    n, m, q = random.integers(2, 6), random.integers(1, 3), random.integers(1, 3)
    A, B, E = (random.integers(-3, 4, s).astype(float) for s in ((n, n), (n, m), (n, q)))
    C = random.integers(-2, 3, (3 + m, n)).astype(float)
    C[3:] = 0.0
    D = np.vstack([np.zeros((3, m)), np.eye(m)])
    weights = 10.0 ** random.uniform(-1, 1, 3 + m)
    W = np.diag(weights)
    P = solve_continuous_are(A, B, C.T @ W @ C, D.T @ W @ D, s=C.T @ W @ D)
    K = -np.linalg.solve(D.T @ W @ D, B.T @ P + D.T @ W @ C)
    X = solve_continuous_lyapunov(A + B @ K, -E @ E.T)
    Y = C + D @ K
    values = np.sqrt(np.einsum("ij,jk,ik->i", Y, X, Y))
    signals = [Output(f"y{i}", C=C[i], D=D[i]) for i in range(3 + m)]
    return UncertainPlant.from_vertices([A], [B], [E]), signals, values


@pytest.mark.parametrize("seed", range(12))
def test_the_best_law_of_a_random_plant_attains_it(seed):
    random = np.random.default_rng(seed)
    while True:
        try:
            plant, signals, values = regulated(random)
        except np.linalg.LinAlgError:
            continue
        if values.min() > 1e-3:
            break
    limits = [Rms(y, float(v), 2.0) for y, v in zip(signals[1:], values[1:], strict=True)]
    found = least_of_any(plant, Rms(signals[0], None, 2.0), limits, 3.0 * values[0])
    assert prove(found.claim).proved
    assert values[0] * (1 - 1e-4) < level(found) <= values[0] * (1 + 1e-9)


# --- the shown car --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ride():
    path = spec_path("quarter-car-ride")
    return load(path), *load_specifications(path)


def test_the_scheduled_law_of_the_page_is_the_best_of_all_laws_to_two_parts_in_a_hundred_thousand(
    ride,
):
    done = optimise(*ride)
    found = done.limit_of_any_law
    assert 1.0 < done.bounds[0].level / level(found) < 1 + 5e-5
    # the force has room: without its limit no law is better
    assert [s.name for s in found.specifications[1:]] == [
        "tyre deflection",
        "suspension deflection",
    ]


def test_laws_that_measure_less_exceed_it(ride):
    measured = Structure(("suspension deflection", "sprung-mass velocity"), schedule=())
    done = optimise(*ride, structure=measured)
    assert 1.02 < done.bounds[0].level / level(done.limit_of_any_law) < 1.05


def test_laws_at_samples_exceed_that_of_the_plant_itself(ride):
    plant, least, limits = ride
    done = optimise(at_sample_time(plant, Fraction(1, 200)), least, limits)
    assert done.limit_of_any_law.plant.sample_time is None
    assert 1.0 < done.bounds[0].level / level(done.limit_of_any_law) < 1.02


def test_more_weight_on_a_signal_goes_by_its_filter(ride):
    plant, least, limits = ride
    weighted = replace(least, weight="Wk")
    found = least_of_any(plant, weighted, limits, 1.0)
    assert found.file().plant.n == 4 + 8  # the filter's states too
    assert level(found) < level(least_of_any(plant, least, limits, 1.0))


# --- what is left out -----------------------------------------------------------------------------


def test_other_kinds_have_none(one):
    for other in (Gain("x"), EnergyPeak("x"), None):
        assert least_of_any(one, other, [Rms("force", FORCE, 2.0)], 1.0) is None


def test_limits_of_other_kinds_and_other_noise_are_left_out(one):
    asked = [Rms("force", FORCE, 2.0), Gain("x", 1.0), EnergyPeak("x", 1.0)]
    alone, beside = (
        least_of_any(one, Rms("x", None, 2.0), limits, 1.0) for limits in (asked[:1], asked)
    )
    assert level(alone) == level(beside)
    half = Rms("force", FORCE, 2.0, disturbances=[("w", 0.5)])
    assert level(least_of_any(one, Rms("x", None, 2.0), [half], 1.0) or alone) <= level(alone)


def test_a_plant_in_discrete_time_or_of_functions_has_none():
    discrete = UncertainPlant.from_vertices([[[0.5]]], [[[1.0]]], [[[1.0]]], sample_time=1)
    assert least_of_any(discrete, Rms("x1", None, 2.0), [Rms("u1", 1.0, 2.0)], 1.0) is None
    of_functions = loads(ONE_STATE.replace('["a"]', '["sin(a)"]').replace('"a"', '"sin(a)"', 1))
    if of_functions.remainder is not None:
        assert least_of_any(of_functions, Rms("x", None, 2.0), [Rms("force", 5, 2.0)], 1.0) is None


# --- faults, one at a time ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def claim(one):
    return least_of_any(one, Rms("x", None, 2.0), [Rms("force", FORCE, 2.0)], 1.0).claim


def test_a_level_that_some_law_keeps_is_not_proved(claim):
    first, *rest = claim.limits
    for share, proved in ((1.0, True), (1.0001, False), (2.0, False)):
        raised = replace(first, level=first.level * Fraction(share))
        assert prove(replace(claim, limits=(raised, *rest))).proved is proved


@pytest.mark.parametrize("share", [0.999, 1.001, -1, 0])
def test_another_matrix_is_not_proved(claim, share):
    P = [[x * Fraction(share) for x in row] for row in claim.P]
    assert not prove(replace(claim, P=P)).proved


@pytest.mark.parametrize("share", [0.99, 1.01, -1, 0])
def test_other_weights_are_not_proved(claim, share):
    first, second = claim.weights
    assert not prove(replace(claim, weights=(first, second * Fraction(share)))).proved


def test_another_vertex_is_not_proved_and_one_outside_is_refused(claim):
    assert not prove(replace(claim, vertex=0)).proved
    for outside in (2, -1):
        with pytest.raises(FormatError, match="vertex"):
            prove(replace(claim, vertex=outside))


# --- the command ----------------------------------------------------------------------------------


def test_the_command_prints_writes_and_checks_it(tmp_path, capsys):
    spec = tmp_path / "one.toml"
    spec.write_text(
        ONE_STATE
        + '[[specification]]\nkind = "rms"\nsignal = "x"\ndensity = 2\nminimise = true\n'
        + '[[specification]]\nkind = "rms"\nsignal = "force"\ndensity = 2\nat_most = 5\n'
    )
    out, summary = tmp_path / "out", tmp_path / "summary.json"
    assert main(["optimise", str(spec), "-o", str(out), "--json", str(summary)]) == 0
    printed = capsys.readouterr().out
    assert "no law, of any order and whatever it measures, goes below 0.1043" in printed
    assert "at vertex 2 (a = 2) within the limit on rms of force; this one is at most" in printed
    told = json.loads(summary.read_text())["limit_of_any_law"]
    assert told["vertex"] == 2
    assert told["within"] == ["rms of force"]
    assert check(out / "limit.json").proved
    assert main(["check", str(out), "--spec", str(spec)]) == 0
    printed = capsys.readouterr().out
    assert "at vertex 2 no law keeps at once rms of 'x'" in printed
    # a level that is raised is not proved
    file = json.loads((out / "limit.json").read_text())
    limit = file["claims"][0]["limits"][0]
    limit["level"] = str(Fraction(limit["level"]) * Fraction(1001, 1000))
    (out / "limit.json").write_text(json.dumps(file))
    assert main(["check", str(out)]) == 1
    # one of an earlier question is told of
    assert main(["optimise", str(spec), "-o", str(out), "--minimise", "gain of x"]) == 0
    assert "limit.json is that of an earlier design" in capsys.readouterr().out


def test_a_signal_with_functions_of_the_parameters_has_no_limit_of_any_law():
    """What the vertices say of it is off, though the plant's own matrices are exact."""
    text = MASS_ON_SPRING + '[outputs]\n"mixed" = {C = ["cos(k/40)", 1]}\n'
    plant = loads(text)
    assert plant.remainder is None
    own = Rms("mixed", density=1)
    assert least_of_any(plant, own, [Rms("force", 0.2, density=1)], 1.0) is None
    (output,) = own.exact_outputs(plant)
    with pytest.raises(FormatError, match="functions of the parameters"):
        require_limit(RmsLimit((output,), Fraction(1), Fraction(1)), 2, 2, 1)
