"""Every kind of requirement: read, written, of another output, designed for, on the pages."""

import re
from contextlib import nullcontext
from dataclasses import replace

import pytest

import polefence as pf
from polefence.proof.claims.base import prove
from polefence.requirements.specification import limit_text
from polefence.requirements.text import KINDS, parse_specification
from support.api import API
from support.lmi_alone import lmi_alone
from support.paths import DOCS
from support.specs import ONE_STATE

LINES = {
    "rms": "rms of x <= 0.8 with density 2",
    "relative rms": "relative rms of x <= 0.8",
    "energy peak": "energy peak of x <= 0.8",
    "initial peak": "initial peak of x <= 5 with impulse 1",
    "saturation": "saturation of force <= 5 with impulse 1",
    "gain": "gain of x <= 1.5",
    "disk margin": "disk margin of force >= 0.5",
    "unmodelled dynamics": "unmodelled dynamics of force >= 0.5 with weight (s+1)/(s+9)",
    "gain margin": "gain margin of force >= 2",
    "phase margin": "phase margin of force >= 30",
    "delay margin": "delay margin of force >= 0.05",
    "worst-case gain": "worst-case gain of x <= 1.5 with inputs [force] with weight (s+1)/(s+9)",
    "sector": "sector of x with disturbance [w] with sector [-0.4, 0.3] >= 1",
    "step": "step of x <= 1.5 with measure peak",
    "initial": "initial of x from [x * 2] <= 3 with measure peak",
    "impulse": "impulse of x <= 2 with measure peak",
    "bump": "bump of x <= 0.2 with height 0.1 with length 2 with speed 1",
    "peak to peak": "peak to peak of x <= 1.5",
    "gain norm": "gain norm of the law <= 50",
}
# Without control x' = -a x + w, a from 0.5 to 2, keeps the others.
ACTIVE = {"rms", "relative rms", "energy peak", "gain", "worst-case gain", "step", "peak to peak"}


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "one.toml"
    path.write_text(ONE_STATE.replace("[0.5, 2]", "[-2, -0.5]"))  # stable, for the ratio's sake
    return pf.load(path)


def test_every_kind_is_tried():
    assert LINES.keys() == KINDS.keys()
    assert all(own.kind == kind for kind, own in KINDS.items())


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_reads_back_from_its_own_words(kind):
    own = parse_specification(LINES[kind])
    assert type(own) is KINDS[kind]
    more = LINES[kind].partition(" with ")[1:]
    line = limit_text(own)
    whole = own.is_margin or " with " in own.title
    assert parse_specification(line if whole else line + "".join(more)) == own


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_designed_for_as_limit_and_as_objective(kind, plant):
    own = parse_specification(LINES[kind])
    if own.of_signal and not own.is_margin:
        (found,) = own.of(plant.signal("force")).outputs(plant)
        assert found == plant.signal("force")
    effort = pf.Rms("force", density=2)
    method = None if own.beyond_lmi(plant) else "quadratic"
    limited = pf.optimise(plant, effort, [own], method=method)
    assert all(prove(bound.claim).proved for bound in limited.bounds)
    assert limited.bounds[1].level <= own.at_most
    assert (limited.bounds[0].level > 0.01) is (kind in ACTIVE)
    assert limited.bounds[0].level < 3  # so that its law is one of those among which the next is
    least = replace(own, at_most=None)
    # the least of what a law of zero has is zero, to which tuning comes nearer and nearer
    with lmi_alone() if kind == "saturation" else nullcontext():
        small = pf.optimise(plant, least, [pf.Rms("force", 3.0, 2)], method=method)
    assert 0 <= small.bounds[0].level <= limited.bounds[1].level * (1 + 1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_on_the_pages(kind):
    assert re.search(rf"\| `{kind}` \|", (DOCS / "ride.md").read_text())
    assert f":: {KINDS[kind].__name__}" in API.replace("polefence.", "")
