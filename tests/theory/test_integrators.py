"""Plants with integrators at a sample time: as good as a Riccati equation of their samples says.

A law that is only to be stable is asked for no decay: around integrators that would cost gain.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize

from polefence import Gain, HalfPlane, NotProvedError, UncertainPlant, optimise
from polefence.response.samples import at_sample_time
from support.lifted import gain


def samples(A, B, E, T):
    """The exact samples of a plant whose inputs are held."""
    n, width = len(A), B.shape[1] + E.shape[1]
    whole = expm(np.block([[A, B, E], [np.zeros((width, n + width))]]) * T)[:n]
    return whole[:, :n], whole[:, n : n + B.shape[1]], whole[:, n + B.shape[1] :]


def keeps(A, B, E, C, level):
    """Whether some u = K x keeps the gain from w to (C x, u) below a level: by doubling."""
    n = len(A)
    F, G, H, eye = A, B @ B.T - E @ E.T / level**2, C.T @ C, np.eye(n)
    for _ in range(60):
        inner = np.linalg.inv(eye + G @ H)
        step = F.T @ H @ inner @ F
        F, G, H = F @ inner @ F, G + F @ inner @ G @ F.T, H + step
        if not np.all(np.isfinite(H)) or np.linalg.eigvalsh((H + H.T) / 2).min() < -1e-9:
            return False
        if np.abs(step).max() <= 1e-13 * np.abs(H).max():
            break
    else:
        return False
    loop = np.linalg.solve(eye + (B @ B.T - E @ E.T / level**2) @ H, A)
    room = level**2 * np.eye(E.shape[1]) - E.T @ H @ E  # u does not know w of its own sample
    stable = np.abs(np.linalg.eigvals(loop)).max() < 1
    return bool(stable and np.linalg.eigvalsh(room).min() > 0)


def least_gain(A, B, E, C):
    low, high = 1e-3, 1e4
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if keeps(A, B, E, C, middle) else (middle, high)
    return high


PLANTS = {
    "two integrators": ([[0, 1], [0, 0]], [[0], [1]], [[0.5], [0]], 0.05),
    "motor": (
        [[0, 1, 0], [0, -8, 0], [2, 0, 0]],
        [[0], [3], [0]],
        [[0, 0], [0.3, 0], [0, -1]],
        0.02,
    ),
    "slow beside an integrator": ([[-0.05, 1], [0, 0]], [[0], [1]], [[1], [0]], 0.1),
}


def described(kind):
    A, B, E, T = PLANTS[kind]
    A, B, E = (np.array(M, dtype=float) for M in (A, B, E))
    plant = UncertainPlant.from_vertices(
        [A], [B], [E], states=[f"x{k}" for k in range(len(A))], inputs=["u"]
    )
    return plant, (A, B, E), T


def signal(plant):
    return (*plant.states, "u")


@pytest.mark.parametrize("kind", PLANTS)
def test_the_gain_of_a_plant_with_integrators_is_the_least_of_any_gain(kind):
    """At all times: no other gain is better, and at samples it is about the Riccati equation's."""
    plant, own, T = described(kind)
    n, m = own[1].shape
    outputs = np.eye(n + m)[:, :n], np.eye(n + m)[:, n:]
    done = optimise(at_sample_time(plant, T, 0), Gain(signal(plant)))

    def truth(K):
        return gain(own, outputs, K.reshape(m, n), T, parts=6, points=100)

    K = np.array(done.law.K).reshape(m, n)
    best = minimize(truth, K.ravel(), method="Nelder-Mead", options={"maxfev": 400}).fun
    level = done.bounds[0].level
    assert truth(K) <= level * (1 + 1e-6)
    assert level <= best * (1 + 2e-3)
    F, G, H = samples(*own, T)
    assert abs(level / least_gain(F, G, H, np.eye(n)) - 1) < 3e-2


@pytest.mark.parametrize("sampled", [True, False])
def test_a_refusal_names_what_was_asked_and_no_region_that_was_not(sampled, lmi_alone):
    plant, own, T = described("two integrators")
    if sampled:
        plant = at_sample_time(plant, T, 0)
    least = least_gain(*samples(*own, T), np.eye(2)) if sampled else 0.1
    limit = Gain(signal(plant), at_most=round(0.9 * least, 3))
    with pytest.raises(NotProvedError) as answer:
        optimise(plant, None, [limit], method="quadratic")
    said = str(answer.value)
    assert f"<= {limit.at_most:g}" in said
    for word in ("disk", "half_plane"):
        assert word not in said


def test_a_refusal_names_the_region_as_it_was_asked(lmi_alone):
    plant, _, T = described("two integrators")
    sampled = at_sample_time(plant, T, 0)
    with pytest.raises(NotProvedError) as answer:
        optimise(sampled, None, [Gain("u", at_most=0.5)], HalfPlane(6), method="quadratic")
    said = str(answer.value)
    assert "half_plane(6)" in said
    assert "disk" not in said
