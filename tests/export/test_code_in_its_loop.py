"""The code in the loop that it was judged in: the plant runs between samples, u waits as it says.

LAW_SAMPLE_TIME and LAW_DELAY are read from the header, as a program would have them.
"""

import ctypes
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import HalfPlane, Structure, UncertainPlant, at_sample_time, place
from polefence.export import check_guarantee, export_c99
from polefence.plant.parameters import Parameter
from polefence.response.discrete import Sampling
from support.cortex import run
from support.hasty import hasty

T, DECAY = 0.02, 0.5
PLACES = [{"m": 1.0, "k": 4.0}, {"m": 1.7, "k": 9.0}, {"m": 2.0, "k": 20.0}]


def spring(m, k):
    return [[0, 1], [-k / m, -0.5 / m]], [[0], [1 / m]]


@cache
def plant():
    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m")]
    states = ["position [m]", "speed [m/s]"]
    return UncertainPlant.from_function(spring, bounds, states=states, inputs=["force [N]"])


@cache
def exported(kind: str, delay: int):
    """Code of a law that was designed at the sample time, of order 1 or of one gain; or before."""
    if kind == "continuous":
        made = place(plant(), HalfPlane(DECAY), "quadratic")
        return export_c99(made, 64, sampling=Sampling(T, bool(delay)))
    sampled = at_sample_time(plant(), T, delay)
    if kind == "one gain":
        return export_c99(place(sampled, HalfPlane(DECAY), "quadratic"), 64)
    late = [own for own in sampled.states if "late" in own]
    structure = Structure(measured=["position", *late], order=1, schedule=[])
    with hasty():
        return export_c99(place(sampled, HalfPlane(DECAY), structure=structure), 64)


def defined(header: str, name: str) -> float:
    return float(re.search(rf"#define LAW_{name} ([0-9.eE+-]+)", header)[1])


class Loop:
    """The compiled code around the plant at one place, from one sample to the next."""

    def __init__(self, made, folder, at) -> None:
        made.save(folder)
        run("cc", "-std=c99", "-shared", "-fPIC", "-O1", "-o", "law.so", "law.c", cwd=folder)
        self.law = ctypes.CDLL(str(folder / "law.so"))
        header = (folder / "law.h").read_text()
        self.delay, time = int(defined(header, "DELAY")), defined(header, "SAMPLE_TIME")
        self.order = int(defined(header, "ORDER")) if "LAW_ORDER" in header else 0
        self.takes = [own.split(" [")[0] for own in made.texts.states]
        A, B = plant().at(plant().alpha(**at))
        self.step = expm(np.block([[A, B], [np.zeros((1, 3))]]) * time)[:2]

    def tick(self, z):
        """Measure, compute, and let the plant run: z is x, the law's own state, u before."""
        x, own, before = z[:2], z[2 : 2 + self.order], z[-1]
        known = {"position": x[0], "speed": x[1]}
        y = [known.get(name, before) for name in self.takes]
        u, memory = (ctypes.c_double * 1)(), (ctypes.c_double * max(self.order, 1))(*own)
        given = [memory] if self.order else []
        assert self.law.law_update(*given, (ctypes.c_double * len(y))(*y), u) == 0
        acting = before if self.delay else u[0]
        return np.concatenate([self.step @ [*x, acting], list(memory)[: self.order], [u[0]]])

    @property
    def poles(self):
        count = 3 + self.order
        return np.linalg.eigvals(np.array([self.tick(unit) for unit in np.eye(count)]).T)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("kind", ["one gain", "order 1", "continuous"])
def test_the_loop_is_the_one_that_is_claimed(host_compiler, tmp_path, kind, delay):
    made = exported(kind, delay)
    assert made.proved
    for k, at in enumerate(PLACES):
        folder = tmp_path / str(k)
        loop = Loop(made, folder, at)
        assert loop.delay == delay
        late = {0: "without delay", 1: "acting 1 sample late"}[delay]
        if kind == "continuous":
            late = "one step late" if delay else "Run every 20 ms:"
        assert late in " ".join((folder / "law.h").read_text().replace(" * ", "").split())
        decay = made.timing.proof.decay if kind == "continuous" else DECAY
        assert np.abs(loop.poles).max() < np.exp(-float(decay) * T)
        if kind != "continuous":
            claimed = exact_poles(made, at)
            own = sorted(loop.poles, key=abs)[-len(claimed) :]
            assert np.allclose(np.poly(own), np.poly(claimed), atol=1e-9)
        if not k:
            assert check_guarantee(folder).proved


def exact_poles(made, at):
    """The poles of the loop of the exact samples, the input a state of the plant where it waits."""
    A, B = plant().at(plant().alpha(**at))
    F = expm(np.block([[A, B], [np.zeros((1, 3))]]) * T)[:2]
    (N, m), order = made.design.plant.shape, made.design.plant.shape[1] - 1
    late = N - order - 2
    whole, held = np.zeros((N, N)), np.zeros((N, m))
    whole[:2, :2] = F[:, :2]
    if late:
        whole[:2, 2] = F[:, 2]
        held[2, 0] = 1.0
    else:
        held[:2, 0] = F[:, 2]
    if order:
        whole[-1, -1], held[-1, -1] = 1.0, T
    return np.linalg.eigvals(whole + held @ made.design.law.gain(np.eye(4)[0]))


def test_code_for_parameters_that_move_is_checked_at_its_sample_time(tmp_path):
    bounds = [replace(parameter, rate=(-1, 1)) for parameter in plant().parameters]
    moving = UncertainPlant.from_function(spring, bounds, inputs=["force [N]"])
    made = export_c99(place(moving, HalfPlane(DECAY), "quadratic"), 64, sampling=Sampling(T, True))
    assert made.proved
    made.save(tmp_path)
    assert check_guarantee(tmp_path).proved
