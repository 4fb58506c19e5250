"""Channels of signals between samples: at times of a period in which inputs are held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polefence.plant.system import Array
from polefence.requirements.slopes import Channel
from polefence.response.between import factor
from polefence.response.held import Storing

# Times of a period, or of each part of one in which the same inputs act, at which a peak is looked
# for: while a law is searched for, and where one is printed.
SEARCHED, PRINTED = 6, 24


def at_times(
    channel: Channel, storing: Storing, alpha: Array, period: float, times: int
) -> Channel:
    """Return the channel of a signal at so many times of each part of a period.

    E makes of noise what the disturbances of a period leave at its end, and ``more`` is what they
    add to the square of the signal before.

    Parameters
    ----------
    channel : Channel
        Of the samples, in their delta form.
    """
    n = channel.A.shape[1]
    moved = storing.moved(alpha, period, times)
    AB, first = np.concatenate([channel.A, channel.B], axis=2), storing.first
    G = np.concatenate([np.broadcast_to(np.eye(n), channel.A.shape), 0 * channel.B], axis=2)
    G[:, first:] += period * AB[:, first:]
    phi = moved.phi - np.eye(len(moved.phi[0]))
    AB[:, :first] = (G @ phi)[:, :first] / period
    E = factor(G @ moved.noise @ np.swapaxes(G, 1, 2)) / period**0.5
    C, F = moved.rows, np.zeros((len(alpha), moved.rows.shape[1], n))
    A, B = AB[..., :n], AB[..., n:]
    return replace(channel, A=A, B=B, E=E, C=C[..., :n], D=C[..., n:], F=F, more=moved.more)
