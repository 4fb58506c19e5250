"""Laws with states of their own of a mass on a spring, and their code called from Python."""

import ctypes
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np

from polefence import Design, FixedGain, HalfPlane, Structure, UncertainPlant, analyse
from polefence.export import export_c99
from polefence.law.laws import PolynomialGain
from polefence.plant.larger import with_states
from polefence.plant.parameters import Parameter
from polefence.response.discrete import Sampling
from support.cortex import run

AFFINE = ((0, 0), (1, 0), (0, 1))
REGION = HalfPlane(0.2)
TIME = 0.01
CORNER = {"m": 1, "k": 20}  # where the coordinates are -1 or 1
K = np.array([[-36.0, 30.0], [10.0, -10.0]])  # near to a filtered derivative


def spring(m, k):
    return [[0, 1], [-k / m, -1 / (2 * m)]], [[0], [1 / m]]


@cache
def design(kind: str) -> Design:
    """A law of the position, of order 1: affine in the parameters, or one gain; or a PID."""
    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m")]
    states = ["position [m]", "speed [m/s]"]
    plant = UncertainPlant.from_function(spring, bounds, states=states, inputs=["force [N]"])
    if kind == "pid":
        structure = Structure(measured=["position"], kind="pid", derivative_bandwidth=2)
        larger, gain = structure.extended(plant)
        y, gains = gain.outputs(larger), np.array([[-6.0, -12.0, -3.0]])
        law = PolynomialGain(AFFINE, [gains, 0.125 * gains, -0.0625 * gains], y, bounds)
        return analyse(larger, law, REGION).design
    larger = with_states(plant, 1)
    if kind == "one gain":  # of all states: one is left out
        return analyse(larger, FixedGain(np.insert(K, 1, 0, axis=1)), REGION).design
    y = tuple(map(larger.signal, ["position", "law state 1"]))
    law = PolynomialGain(AFFINE, [K, 0.125 * K, -0.0625 * K], y, larger.parameters)
    return analyse(larger, law, REGION).design


def exported(kind: str, bits: int, late: bool = True):
    """The design's code, made once."""
    return _exported(kind, bits, late)


@cache  # which tells what is left out from what is given
def _exported(kind: str, bits: int, late: bool):
    return export_c99(design(kind), bits, sampling=Sampling(TIME, late), limits=800.0)


class Code:
    """The code, compiled: one update after another."""

    def __init__(self, made, folder: Path) -> None:
        made.save(folder)
        run("cc", "-std=c99", "-shared", "-fPIC", "-O1", "-o", "law.so", "law.c", cwd=folder)
        self.library = ctypes.CDLL(str(folder / "law.so"))
        self.real = ctypes.c_float if made.program.number.bits == 32 else ctypes.c_double
        self.order, self.inputs = made.program.memory.states, len(made.texts.inputs)
        self.memory = (self.real * self.order)()

    def reset(self) -> None:
        self.library.law_reset(self.memory)

    @property
    def states(self) -> list[float]:
        return list(self.memory)

    @states.setter
    def states(self, values) -> None:
        self.memory[:] = values

    def update(self, given, y) -> tuple[list[float], int]:
        u = (self.real * self.inputs)()
        given = [] if given is None else [(self.real * len(given))(*given)]
        flags = self.library.law_update(self.memory, *given, (self.real * len(y))(*y), u)
        return list(u), flags


def exactly(values) -> np.ndarray:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(values, dtype=float))
