"""Rms relative to that without control: of plants with states of a law, of hardware, of samples.

What the signal does not depend on without control is no part of what it is compared with: the
states of a law stand still, and count as poles at zero.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from polefence import FixedGain, Parameter, RelativeRms, UncertainPlant, at_sample_time
from polefence.base.errors import InputError
from polefence.certify import bounds
from polefence.plant.exact import file_plant
from polefence.plant.larger import with_actuator, with_pid, with_sensor, with_states
from polefence.plant.outputs import pick, states
from polefence.plant.samples import claim_of_samples
from polefence.proof.claims.base import prove
from polefence.proof.document import Document, from_plain, loads
from polefence.proof.remainder import Remainder
from polefence.proof.work import FormatError
from support.commands import ran

SPEC = """
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["gust [N]"]
[parameter.k]
range = [1, 1.2]
[matrices]
A = [[0, 1], ["-k", -1]]
B = [[0], [1]]
E = [[0], [1]]
[law]
measured = ["x"]
order = 1
[[specification]]
kind = "relative rms"
signal = "x"
density = 0.5
minimise = true
[[specification]]
kind = "rms"
signal = "u"
density = 0.5
at_most = 0.5
"""
ORDER = {"u": {"x": -1, "law state 1": -2}, "law": {"x": 1, "v": 1, "law state 1": -3}}
SEEN = {"u": {"measured x": -1, "law state 1": -1}, "law": {"measured x": 1, "law state 1": -3}}
PID = {"u": {"x": -1, "v": -1, "pid integral of x": -0.5}}


def spring(step=None, damping="-1") -> UncertainPlant:
    A, B = [["0", "1"], ["-k", damping]], [["0"], ["1"]]
    if step is not None:
        A, B = [["1", "0.1"], ["-0.1*k", "0.9"]], [["0"], ["0.1"]]
    names = {"states": ("x", "v"), "inputs": ("u",), "disturbances": ("w",)}
    own = [Parameter("k", 1, 1.2, "N/m")]
    return UncertainPlant.from_expressions(own, A, B, B, sample_time=step, **names)


def hardware():
    return with_sensor(with_actuator(spring(), "u", 2), "x", 3, 0.01)


def with_integral():
    return with_pid(spring(), [pick(states(spring()), "x")], 5)[0]


# The plant, its law, and the states that x depends on without control.
CASES = {
    "order": (lambda: with_states(spring(), 1), ORDER, (0, 1)),
    "order, discrete": (lambda: with_states(spring("0.1"), 1), ORDER, (0, 1)),
    "order, hardware": (lambda: with_states(hardware(), 1), SEEN, (0, 1, 2)),
    "integral": (with_integral, PID, (0, 1)),
    "order, samples": (lambda: with_states(at_sample_time(spring(), 0.05), 1), ORDER, (0, 1)),
}


def law_of(plant, rows) -> FixedGain:
    names, K = [own.name for own in states(plant)], np.zeros(plant.shape[::-1])
    for i, row in enumerate(rows.values()):
        for name, value in row.items():
            K[i, names.index(name)] = value
    return FixedGain(K)


def worst(plant, law, kept) -> float:
    """The largest ratio at points of the family, by scipy."""
    found, left = 0.0, list(kept)
    for share in np.linspace(0, 1, 201):
        alpha = np.array([1 - share, share])
        (A, B), E = plant.at(alpha), plant.driven(alpha)

        def variance(A, E):
            if plant.sample_time is None:
                return solve_continuous_lyapunov(A, -E @ E.T)[0, 0]
            return solve_discrete_lyapunov(A, E @ E.T)[0, 0]

        alone = variance(A[np.ix_(left, left)], E[left])
        found = max(found, variance(A + B @ law.K, E) / alone)
    return float(found**0.5)


def file_of(plant, law, claim) -> Document:
    more = () if plant.sampling is None else (claim_of_samples(plant),)
    whole = file_plant(plant)
    more = tuple(replace(own, plant=whole) for own in more)
    return Document(whole, law.exact, (claim, *more), claim.subject.on)


@pytest.mark.parametrize("transfer", [True, False], ids=["transfer", "polynomials"])
@pytest.mark.parametrize("name", CASES)
def test_states_that_do_not_matter_without_control_are_left_out(name, transfer, monkeypatch):
    if not transfer:
        monkeypatch.setattr(bounds, "_by_transfer", lambda _: iter(()))
    build, rows, kept = CASES[name]
    plant = build()
    law = law_of(plant, rows)
    claim = bounds.best_bound(plant, law, RelativeRms("x")).claim
    assert claim.subject.evidence.transfer is (transfer and plant.remainder is None)
    assert claim.baseline.states == kept
    true = worst(plant, law, kept)
    assert true < claim.level < 1.002 * true < 0.9
    document = file_of(plant, law, claim)
    document.require_checkable()
    assert "of that of no control" in claim.said(document.plant)


def test_the_baseline_of_a_plant_without_such_states_is_all_of_it():
    claim = bounds.best_bound(spring(), FixedGain([[-1, -1]]), RelativeRms("x")).claim
    assert claim.baseline.states == ()
    assert "states" not in claim.write()["baseline"]


def test_a_file_cannot_leave_out_what_matters(monkeypatch):
    monkeypatch.setattr(bounds, "_by_transfer", lambda _: iter(()))
    plant = with_states(spring(), 1)
    law = law_of(plant, ORDER)
    claim = bounds.best_bound(plant, law, RelativeRms("x")).claim
    text = file_of(plant, law, claim).dumps()
    for own in ([1], [2], [1, 3]):
        table = json.loads(text)
        table["claims"][0]["baseline"]["states"] = own
        with pytest.raises(FormatError, match="depends on a state left out"):
            from_plain(table)
    table = json.loads(text)
    table["claims"][0]["baseline"]["states"] = [1, 2, 3]  # with the law's own: not stable
    with pytest.raises(FormatError, match="baseline"):
        prove(from_plain(table).claims[0])
    # of what is off by a remainder the same is asked
    plant = with_states(at_sample_time(spring(), 0.05), 1)
    claim = bounds.best_bound(plant, law, RelativeRms("x")).claim
    rows = [list(row) for row in claim.subject.remainder.entries]
    rows[0][2] = rows[0][0]
    off = Remainder(tuple(map(tuple, rows)), claim.subject.remainder.curve, 2)
    assert not replace(claim, subject=replace(claim.subject, remainder=off)).without_control
    assert loads(file_of(plant, law, claim).dumps()).claims[0].without_control


def test_what_matters_must_be_stable():
    plant = with_states(spring(damping="1"), 1)
    law = law_of(plant, {"u": {"x": -1, "v": -4}, "law": {"law state 1": -3}})
    with pytest.raises(InputError, match="stable"):
        bounds.best_bound(plant, law, RelativeRms("x"))


@pytest.mark.usefixtures("hasty")
def test_the_command_designs_a_law_with_states(tmp_path, capsys):
    spec = tmp_path / "plant.toml"
    spec.write_text(SPEC)
    assert "relative rms of x" in ran(capsys, "optimise", spec, "-o", tmp_path)
    assert "of that of no control" in ran(capsys, "check", tmp_path / "design.json", "--spec", spec)
