"""Two masses and a spring of 0.5 to 50 N/m under a law of degree 4: LQR at five stiffnesses."""

import numpy as np
from scipy.linalg import solve_continuous_are

from polefence.law.laws import PolynomialGain
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter

DECAY, EFFORT, POINTS = 0.3, 0.1, 4001


def masses(low=0.5, high=50):
    """The force acts on the first mass; the spring is damped a little."""
    A = [[0, 0, 1, 0], [0, 0, 0, 1], ["-k", "k", -0.02, 0.02], ["k", "-k", 0.02, -0.02]]
    return UncertainPlant.from_expressions(
        [Parameter("k", low, high, "N/m")], A, [[0], [0], [1], [0]]
    )


def scheduled(plant, degree=4):
    """The polynomial that has the LQR gains of some stiffnesses."""
    c = np.cos(np.pi * np.arange(degree + 1) / degree)
    gains = []
    for x in c:
        A, B = plant.at([(1 - x) / 2, (1 + x) / 2])
        X = solve_continuous_are(A + DECAY * np.eye(4), B, np.eye(4), EFFORT * np.eye(1))
        gains.append(-B.T @ X / EFFORT)
    K = np.tensordot(np.linalg.inv(np.vander(c, increasing=True)), np.array(gains), 1)
    return PolynomialGain(tuple((k,) for k in range(degree + 1)), K, (), plant.parameters)


def poles(plant, law):
    """Closed-loop poles at many stiffnesses, (points, n)."""
    t = np.linspace(0, 1, POINTS)
    alpha = np.stack([1 - t, t], axis=-1)
    A, B = plant.at(alpha)
    return np.linalg.eigvals(A + B @ law.gain(alpha))
