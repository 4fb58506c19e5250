"""Designs at a sample time, driven: as a recursion of SciPy's exponentials has it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    FixedGain,
    HalfPlane,
    InputError,
    Scheduled,
    Structure,
    at_sample_time,
    optimise,
    place,
)
from polefence.certify.running import running
from polefence.cli.main import main
from polefence.plant.larger import own_states
from polefence.plant.spec import loads
from polefence.vehicle.driving.drive import Setup, run
from polefence.vehicle.driving.parts import Hardware
from polefence.vehicle.excitation import excited
from support.commands import ran, refused
from support.specs import TWO_STATES, rms

T = 0.05
ONE = Structure(("x",), (), order=1, largest_gain=2.0)
KINDS = {
    "one gain": lambda seen: place(seen, HalfPlane(0.05), "quadratic"),
    "Z W^-1": lambda seen: place(seen, HalfPlane(0.05), Scheduled(1, 0, "box")),
    "order 1": lambda seen: place(seen, HalfPlane(0.03), structure=ONE),
    "affine": lambda seen: (
        optimise(seen, rms("x"), [rms("force", 1.0)], structure=Structure()).design
    ),
}


@pytest.fixture(scope="module")
def plant():
    return loads(TWO_STATES)


def by_hand(plant, design, alpha, start, count):
    """x at samples: the plant by its exponential in either part of a period, the law by numbers."""
    A, B = plant.at(alpha)
    sampling, kept = design.plant.sampling, own_states(design.plant)
    delay, K = sampling.delay, design.law.gain(alpha[None])[0]
    x, late, z = np.array(start), np.zeros(delay), np.zeros(kept)
    found = [x]
    for _ in range(count):
        out = K @ np.concatenate([x, late, z])
        sent = [*out[:1], *late]
        for share, u in ((1 - sampling.early, sent[delay]), (sampling.early, sent[delay - 1])):
            whole = expm(np.block([[A, B], [np.zeros((1, 3))]]) * T * float(share))
            x = whole[:2, :2] @ x + whole[:2, 2] * u
        late, z = np.array(sent[:delay]), z + T * out[1:]
        found.append(x)
    return np.array(found)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("delay", [0, 1, 0.5, 1.3])
def test_the_drive_is_the_recursion_that_was_designed(plant, kind, delay):
    design = KINDS[kind](at_sample_time(plant, T, delay))
    found = running(plant, design)
    assert (found.sampling.period, float(found.sampling.delay)) == (T, delay)
    moved = excited(found.plant, 4.0, T / 5, start={"x": 1.0})
    hardware = Hardware(sampling=found.sampling)
    own = run(Setup(found.plant, moved, {"m": 1.1, "k": 2.5}, hardware=hardware), found.law)
    alpha = np.array(plant.alpha(m=1.1, k=2.5), dtype=float)
    expected = by_hand(plant, design, alpha, [1.0, 0.0], 80)
    for k, name in enumerate(("x", "v")):
        assert np.allclose(own.response.of(name)[0][::5], expected[:, k], atol=1e-6)
    assert not any("no claim" in note for note in own.notes)
    columns = [own.name for own in own.response.signals] + [name for name, *_ in own.more]
    assert not any(name.startswith("rate of ") for name in columns)
    assert "force demanded" in columns


def test_what_cannot_be_driven_is_refused(plant):
    bare = place(plant, HalfPlane(0.1), "quadratic")
    with pytest.raises(InputError, match="the design has no sample time"):
        running(plant, bare)
    seen = at_sample_time(plant, T, 1)
    scheduled = place(seen, HalfPlane(0.05), Scheduled(1, 0, "box"))
    prompt = place(at_sample_time(plant, T), HalfPlane(0.05), Scheduled(1, 0, "box"))
    assert running(plant, prompt).law is prompt.law
    far = at_sample_time(plant, T, 20.5)
    law = FixedGain(np.zeros((1, far.shape[0])))
    with pytest.raises(InputError, match=r"20.5 samples late: .* 21 numbers .* at most 20"):
        running(plant, SimpleNamespace(plant=far, law=law))
    with pytest.raises(InputError, match="is not the plant that the design samples"):
        running(seen, scheduled)


def test_the_command_drives_it(plant, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.toml").write_text(TWO_STATES)
    words = ["--region", "half_plane(0.05)", "--method", "quadratic", "--sample-time", "0.05"]
    assert main(["design", "two.toml", *words, "--delay", "1", "-o", "law"]) == 0
    moved = ["simulate", "two.toml", "--law", "law", "--initial", "x=1", "--duration", "20"]
    said = ran(capsys, *moved, "--json", "summary.json")
    assert "at samples every 50 ms, for every constant value of the parameters" in said
    assert "in no claim" not in said
    (law,) = json.loads((tmp_path / "summary.json").read_text())["laws"]
    assert law["signals"][0]["peak"] == 1.0
    assert "is simulated alone" in refused(capsys, *moved, "--law", "passive")
    assert "the design has 0.05 s; leave it out" in refused(capsys, *moved, "--sampling", "0.01")
    (tmp_path / "other.toml").write_text(TWO_STATES.replace("[1, 3]", "[1, 4]"))
    moved[1] = "other.toml"
    assert "nothing: its proof is about another plant" in ran(capsys, *moved)
