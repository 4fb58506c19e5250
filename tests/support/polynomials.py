"""Polynomial laws of the ride car, of every form: of states, of signals, of outputs that vary."""

from dataclasses import replace
from functools import cache

import numpy as np

from polefence import Design, HalfPlane, UncertainPlant, analyse
from polefence.examples import family
from polefence.law.laws import PolynomialGain
from polefence.plant.outputs import Output

REGION = HalfPlane(0.5)
K0 = np.array([[9000.0, 0.0, -2000.0, 150.0]])
AFFINE, SHARES = ((0, 0), (1, 0), (0, 1)), (1, 0.1, -0.05)
SQUARE, MORE = (*AFFINE, (2, 0), (1, 1)), (*SHARES, 0.02, -0.03)
IN_ALPHA = ((2, 0, 0, 0), (1, 1, 0, 0), (0, 2, 0, 0), (0, 0, 2, 0), (0, 0, 0, 2), (0, 0, 1, 1))
KINDS = ("affine", "square", "one gain", "measured", "many", "varying", "third", "alpha")


def _of(K, shares):
    return [share * np.array([K]) for share in shares]


def made(kind: str) -> tuple[UncertainPlant, PolynomialGain]:
    """The plant and a law that keeps its poles in `REGION`."""
    plant = family("quarter-car-ride")
    own = plant.parameters
    names = ("suspension deflection", "sprung-mass velocity", "unsprung-mass velocity")
    y = tuple(map(plant.signal, names))
    rate = Output("rate of deflection", "m/s", C=[0, 0, 1, -1])
    third = Output("a third", "m", C=["1/3", "0.1", 0, 0])  # no doubles
    force = Output("spring force", "kN", C=[[15 + k, 0, 0, 0] for k in range(4)])
    signals = [9000, -2000, 150]
    if kind == "affine":
        return plant, PolynomialGain(AFFINE, _of(K0[0], SHARES), (), own)
    if kind == "square":
        return plant, PolynomialGain(SQUARE, _of(K0[0], MORE), (), own)
    if kind == "one gain":
        return plant, PolynomialGain(((0, 0),), _of(signals, (1,)), y, own)
    if kind == "measured":
        return plant, PolynomialGain(AFFINE, _of(signals, SHARES), y, own)
    if kind == "many":  # more signals than states
        plant = replace(plant, outputs=(*plant.outputs, rate, third))
        K = [9000, -1500, 100, -500, 30]
        return plant, PolynomialGain(AFFINE, _of(K, SHARES), (*y, rate, third), own)
    if kind == "varying":
        plant = replace(plant, outputs=(*plant.outputs, force))
        return plant, PolynomialGain(AFFINE, _of([600, -2000, 150], SHARES), (force, *y[1:]), own)
    if kind == "third":
        plant = replace(plant, outputs=(*plant.outputs, third))
        return plant, PolynomialGain(AFFINE, _of([27000, -2000, 150], SHARES), (third, *y[1:]), own)
    plant = replace(plant, parameters=())
    return plant, PolynomialGain(IN_ALPHA, _of(signals, (1, 2, 1.1, 0.9, 1.2, 2.1)), y)


@cache
def design(kind: str) -> Design:
    """The law, proved."""
    return analyse(*made(kind), REGION).design
