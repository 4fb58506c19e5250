"""The passive quarter car without its integral state, which has a pole at zero."""

import numpy as np

from polefence.examples import family
from polefence.response.closed import close


def car(alpha):
    loops = close(family("quarter-car-physical"), None, alpha)
    A, E = loops.closed[:, :4, :4], loops.E[:, :4, :]
    return A, E, A[:, 2:3, :], E[:, 2:3, :]


def gains(system, frequency):
    A, E, C, D = (m[:, None] for m in system)
    s = 2j * np.pi * frequency[:, None, None]
    return (C @ np.linalg.solve(s * np.eye(4) - A, E + 0j) + D)[..., 0, 0]
