"""Scales of opened loops in parts of the box: against theory, samples, and one fault at a time."""

import copy
import json
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound, kept_bound
from polefence.cli.main import main
from polefence.law.laws import given_law
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError
from polefence.requirements.disk_margin import DiskMargin, Unmodelled
from polefence.requirements.worst_gain import WorstCaseGain
from support.specs import CROSSED

PATHS = ["v1 -> w1", "v2 -> w2"]


def crossed(**changes):
    text = CROSSED
    for old, new in changes.items():
        text = text.replace(old, new)
    plant = loads(text)
    return plant, given_law(plant, np.zeros((1, 2)))


def random_family(seed, size=0.25):
    """A plant with two inputs and two parameters, with the law that is best in the middle."""
    random = np.random.default_rng(seed)
    n, m = int(random.integers(3, 5)), 2
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    moved = [(size * random.normal(size=(n, n)), size * random.normal(size=(n, m))) for _ in "pq"]
    K = -B.T @ solve_continuous_are(A, B, np.eye(n), np.eye(m))

    def written(M, k):
        rows = [
            ", ".join(
                f'"{M[i, j]:.3f} + {moved[0][k][i, j]:.3f}*p + {moved[1][k][i, j]:.3f}*q"'
                for j in range(M.shape[1])
            )
            for i in range(n)
        ]
        return "[[" + "], [".join(rows) + "]]"

    E, C = random.normal(size=n).round(2).tolist(), random.normal(size=n).round(2).tolist()
    plant = loads(
        f"""
name = "random {seed}"
states = {json.dumps([f"x{i + 1}" for i in range(n)])}
inputs = ["u1", "u2"]
disturbances = ["w"]
[parameter.p]
range = [-1, 1]
[parameter.q]
range = [-1, 1]
[matrices]
A = {written(A, 0)}
B = {written(B, 1)}
E = {[[x] for x in E]}
[outputs]
"z" = {{C = {C}}}
"""
    )
    return plant, given_law(plant, K)


@pytest.mark.parametrize("time_invariant", [False, True])
def test_parts_of_the_box_have_scales_of_their_own(time_invariant):
    plant, law = crossed()
    asked = Unmodelled(PATHS, weight=1, time_invariant=time_invariant)
    bound = best_bound(plant, law, asked)
    assert 2 < bound.level < 2.2
    assert len(bound.claim.subject.evidence.cells) > 4
    assert prove(bound.claim).proved
    assert asked.values(plant, law, seeded(plant, 200)).max() == pytest.approx(2, rel=1e-3)
    assert kept_bound(plant, law, Unmodelled.least(PATHS, 1, 1 / 2.3)) is not None
    assert kept_bound(plant, law, Unmodelled.least(PATHS, 1, 1 / 1.99)) is None


def test_parameters_that_move_have_one_scale():
    plant, law = crossed(**{"range = [-1, 1]": "range = [-1, 1]\nrate = [-1, 1]"})
    level = best_bound(plant, law, Unmodelled(PATHS, weight=1)).level
    assert level == pytest.approx(3, rel=1e-3)


def test_bounds_of_a_random_family_are_near_samples_of_plants_scaled_alone():
    plant, law = random_family(15)
    asked = DiskMargin(["u1", "u2"])
    bound = best_bound(plant, law, asked)
    worst = asked.values(plant, law, seeded(plant, 400)).max()
    assert worst <= bound.level * (1 + 1e-6)
    assert bound.level <= worst * 1.003  # 1.105 of one scale
    assert len(bound.claim.subject.evidence.cells) > 1
    with pytest.raises(InputError, match="by the transfer function, without a Lyapunov matrix"):
        bound.lyapunov_at(p=0.2, q=0.1)


@pytest.mark.parametrize(
    ("signal", "weight", "one", "near"),
    [("v1", 0.3, 22, 1.09), (["v1", "v2"], 0.3, 31, 1.13), (["v1", "v2"], 0.2, 7.6, 1.05)],
)
def test_worst_case_gains_are_near_those_of_the_worst_dynamics(signal, weight, one, near):
    """One scale of the whole box has several times as much, and is found from far too."""
    plant, law = crossed()
    asked = WorstCaseGain(signal, inputs=PATHS, weight=weight)
    assert 0.9 * one < asked.nearest(plant, law) < one
    bound = best_bound(plant, law, asked)
    worst = asked.values(plant, law, seeded(plant, 400)).max()
    assert worst <= bound.level <= worst * near


def saved(tmp_path, limit):
    """The document of the crossed plant with a limit, as `verify` writes it."""
    spec = tmp_path / "crossed.toml"
    spec.write_text(CROSSED)
    words = ["--region", "half_plane(0)", "--limit", limit, "-o", str(tmp_path / "out")]
    assert main(["verify", str(spec), "--gain", "[0 0]", *words]) == 0
    return json.loads((tmp_path / "out" / "design.json").read_text())


LIMIT = "unmodelled dynamics of [v1 -> w1, v2 -> w2] with weight 1"


def answer(document):
    """What `check` says of a document: proved or not, or why it is none."""
    try:
        return check(from_plain(document)).proved
    except FormatError as error:
        return str(error)


def test_a_file_is_checked_part_by_part(tmp_path, capsys):
    document = saved(tmp_path, LIMIT)
    assert main(["check", str(tmp_path / "out")]) == 0
    assert "in 12 parts of the box" in capsys.readouterr().out
    (claim,) = (one for one in document["claims"] if one["kind"] == "unmodelled dynamics")
    cells = claim["evidence"]["cells"]
    assert answer(document) is True

    def without(change):
        other = copy.deepcopy(document)
        (own,) = (one for one in other["claims"] if one["kind"] == "unmodelled dynamics")
        change(own, own["evidence"]["cells"])
        return answer(other)

    for k in (0, len(cells) - 1):
        assert without(lambda own, cells, k=k: cells.pop(k)) is False

        def heavier(own, cells, k=k):
            cells[k]["weights"][0] = str(Fraction(cells[k]["weights"][0]) * 2)

        assert without(heavier) is False

    def larger(own, cells):
        own["level"] = str(Fraction(own["level"]) * Fraction(98, 100))

    def alike(own, cells):
        cells[0]["weights"] = cells[-1]["weights"]

    def twice(own, cells):
        cells.append(cells[0])

    for change in (larger, alike, twice):
        assert without(change) is False

    def unweighted(own, cells):
        del cells[0]["weights"]

    def one_weight(own, cells):
        cells[0]["weights"] = cells[0]["weights"][:1]

    def negative(own, cells):
        cells[0]["weights"][0] = -1

    def with_leads(own, cells):
        cells[0] |= {"zeros": [1, 2], "poles": [2, 1]}

    def with_own_leads(own, cells):
        own |= {"invariant": True, "zeros": [1, 2], "poles": [2, 1]}

    def elsewhere(own, cells):
        cells[0]["low"] = [-1]

    for change in (unweighted, one_weight, negative, with_leads, with_own_leads, elsewhere):
        assert isinstance(without(change), str), change


def test_weights_of_parts_belong_to_opened_loops(tmp_path):
    document = saved(tmp_path, LIMIT)
    document["claims"] = [one for one in document["claims"] if one["kind"] == "region"]
    evidence = document["claims"][0]["evidence"]
    (own,) = evidence["parts"]
    evidence["parts"] = [{"cells": [{"low": [0], "high": [1]} | own]}]
    assert answer(document) is True
    evidence["parts"][0]["cells"][0]["weights"] = [1, 1]
    assert "weights" in answer(document)


def test_what_moves_has_no_scales_of_parts(tmp_path):
    document = saved(tmp_path, LIMIT)
    document["claims"] = [one for one in document["claims"] if one["kind"] != "region"]
    document["plant"]["parameters"][0]["rate"] = [-1, 1]
    assert "do not move" in answer(document)
