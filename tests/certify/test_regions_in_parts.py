"""Given laws of which no one Lyapunov polynomial proves the region: proved in parts, or refuted."""

import math

import numpy as np
import pytest

from polefence.certify import evidence
from polefence.certify.at_samples import at_samples
from polefence.certify.candidates import Deadline
from polefence.certify.design import Design, check
from polefence.certify.evaluation import rounding_share
from polefence.certify.evidence import MOST_PARTS, Search, certificate_of, evidence_at, forms
from polefence.certify.given import analyse, worst_case
from polefence.certify.margins.gain_scales import gain_claim
from polefence.certify.margins.service import in_service
from polefence.cli.service import _explained
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.proof import matrices
from polefence.region.regions import Disk, HalfPlane, Sector
from polefence.search.place import place
from support.scheduled_masses import masses, poles, scheduled


@pytest.fixture(scope="module")
def loop():
    plant = masses()
    law = scheduled(plant)
    return plant, law, poles(plant, law)


def regions(z, share):
    """A region of each kind, by a share inside what poles have, or beyond it."""
    decay, damping = -z.real.max(), float((-z.real / np.abs(z)).min())
    return {
        "half_plane": HalfPlane(decay * (1 - share)),
        "sector": Sector(damping * (1 - share)),
        "both": HalfPlane(decay * (1 - share)) & Sector(damping * (1 - share)),
    }


@pytest.mark.parametrize("kind", ["half_plane", "sector", "both"])
def test_both_sides_of_the_worst_pole(loop, kind, tmp_path):
    """Proved just inside, where no polynomial of the whole box does; refuted just beyond."""
    plant, law, z = loop
    region = regions(z, 1e-3)[kind]
    for form in forms(plant, law):
        assert evidence_at(plant, law, region.parts[0], form) is None
    found = analyse(plant, law, region)
    assert found.answer == "proved"
    assert "parts of the box" in found.reason
    assert found.certificate.in_parts
    found.design.save(tmp_path)
    assert check(tmp_path).proved
    assert Design.load(tmp_path).certificate.claim() == found.certificate.claim()
    beyond = analyse(plant, law, regions(z, -1e-3)[kind])
    assert beyond.answer == "refuted"
    assert regions(z, -1e-3)[kind].distance(beyond.poles(np.array(beyond.alpha, float))).max() > 0


@pytest.mark.parametrize("of", ["half_plane", "sector"])
def test_the_worst_case_is_proved_in_parts(loop, of):
    plant, law, z = loop
    found = worst_case(plant, law, of)
    exact = -z.real.max() if of == "half_plane" else float((-z.real / np.abs(z)).min())
    value = found.region.numbers["decay" if of == "half_plane" else "damping"]
    assert exact * (1 - 1e-3) < value < exact * (1 + 1e-6)
    assert found.certificate.in_parts
    assert found.certificate.prove().proved


def test_a_part_in_which_a_pole_leaves_refutes(loop):
    """Even where nobody looked for a counterexample before the box was halved."""
    plant, law, z = loop
    search = Search(plant, law, regions(z, -1e-4)["half_plane"], Deadline())
    assert search.in_parts() is None
    assert sum(search.alpha) == 1
    alpha = np.array([float(a) for a in search.alpha])
    A, B = plant.at(alpha)
    worst = np.linalg.eigvals(A + B @ law.gain(alpha)).real.max()
    assert worst > z.real.max() * (1 + 1e-4)


def test_what_cannot_be_divided_is_not():
    """A law with an inverse, three vertices, one plant alone."""
    A = [[[-1.0 - k]] for k in range(3)]
    plants = [UncertainPlant.from_vertices(A[:N], [[[1.0]]] * N) for N in (1, 2, 3)]
    gain = FixedGain(np.zeros((1, 1)))
    most = [Search(own, gain, HalfPlane(0), Deadline()).most for own in plants]
    assert most == [1, MOST_PARTS, 1]
    one = ScheduledGain(np.ones((2, 1, 1)), np.zeros((2, 1, 1)))
    assert Search(plants[1], one, HalfPlane(0), Deadline()).in_parts() is None


def test_a_budget_ends_it(loop):
    plant, law, z = loop
    found = analyse(plant, law, regions(z, 1e-3)["half_plane"], budget=0)
    assert found.answer == "undecided"
    assert "budget" in found.reason


def test_it_is_undecided_where_the_parts_are_too_many(loop):
    plant, law, z = loop
    search = Search(plant, law, regions(z, 1e-3)["half_plane"], Deadline())
    search.most = 2
    assert search.in_parts() is None
    assert search.alpha is None
    assert search.tried.endswith("nor in 2 parts of the box")


def test_work_bounds_the_parts(loop, monkeypatch):
    """Before it begins, of all parts of a region together; and while it is done."""
    plant, law, z = loop
    region = regions(z, 1e-3)["half_plane"]
    least = matrices.least_work(evidence._blocks(plant, law, (1, 0)), 8)
    assert evidence._most_parts(plant, law, 1) == evidence.MOST_PARTS
    with monkeypatch.context() as patch:
        patch.setattr(evidence.work, "MAX_WORK", 40 * least)
        assert Search(plant, law, region, Deadline()).most == 40
        assert Search(plant, law, region, Deadline(), 2).most == 10
    search = Search(plant, law, region, Deadline())
    search.share = 1e-6  # the first proof is more
    assert search.in_parts() is None


def test_rounding_is_judged_in_each_part(loop):
    """As much as of the whole box where both prove it; evidence of another part fits nothing."""
    plant, law, _ = loop
    region = Disk(-20, 22)
    whole = analyse(plant, law, region).certificate
    assert not whole.in_parts
    proof = Search(plant, law, region, Deadline()).in_parts()
    halves = type(whole)(plant, region, "lyapunov", law, {"parts": (proof,)})
    assert halves.prove().proved
    assert 0.01 < rounding_share(halves) / rounding_share(whole) < 100
    one, two, *rest = proof["cells"]
    ends = ("low", "high")
    swapped = [{**a, **{key: b[key] for key in ends}} for a, b in ((one, two), (two, one))]
    wrong = type(whole)(plant, region, "lyapunov", law, {"parts": ({"cells": (*swapped, *rest)},)})
    assert not wrong.prove().proved
    assert rounding_share(wrong) > 1e3 * rounding_share(halves)


def test_margins_of_it(loop):
    """An error of the gain in parts; rates and estimates not, which need one polynomial."""
    plant, law, z = loop
    design = analyse(plant, law, regions(z, 0.1)["half_plane"]).design
    margins = in_service(design)
    gain = margins["gain"]
    assert 0 < gain.value < gain.upper
    assert all(not own.proved for own in margins if own.kind != "gain")
    assert any("proved in parts of the box" in line for line in _explained(margins))


def test_the_gain_of_a_sampled_loop_may_be_off_as_floats_say_in_each_part():
    """The parts have curves and remainders of their own, and Omega in each grows with the error."""
    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m")]
    plant = UncertainPlant.from_function(
        lambda m, k: ([[0, 1], [-k / m, -1 / (2 * m)]], [[0], [1 / m]]), bounds
    )
    law = place(plant, HalfPlane(1) & Sector(0.3), "quadratic").law
    sampled, law = at_samples(plant, law, 0.02)
    inner, outer = (Disk(0, math.exp(-rate * 0.02)) for rate in (2, 1))
    parts = Search(sampled, law, inner, Deadline(None)).in_parts()
    assert len(parts["cells"]) > 1
    design = Design(certificate_of(sampled, law, outer, [parts]))
    largest, claim = gain_claim(design, np.ones(1), np.ones(3), 1e-6)
    assert claim is not None
    assert gain_claim(design, np.ones(1), np.ones(3), 0.9 * largest)[1] is not None
    assert gain_claim(design, np.ones(1), np.ones(3), 1.1 * largest)[1] is None
