"""Random stable plants, affine in a parameter, and what is measured of them."""

import numpy as np
from scipy.integrate import solve_ivp

from polefence.data import FrequencyResponse, Response

POINTS = (1.0, 1.3, 1.6, 2.0)
BAND = np.geomspace(0.05, 12, 90)  # rad/s


def companion(order, inputs, outputs, source):
    """Matrices at the middle and their change to the ends, of chains one for each output.

    The rows of the chains' ends are free, and so is B: every plant of this order has such a form.
    """
    share, rest = divmod(order, outputs)
    lengths = [share + (i < rest) for i in range(outputs)]
    ends, starts = np.cumsum(lengths) - 1, np.cumsum([0, *lengths[:-1]])
    C = np.zeros((outputs, order))
    C[range(outputs), starts] = 1
    while True:
        poles = list(-source.uniform(0.3, 2, order % 2))
        for _ in range(order // 2):
            speed, damping = source.uniform(0.4, 3), source.uniform(0.1, 0.6)
            poles += list(speed * (-damping + np.array([1j, -1j]) * np.sqrt(1 - damping**2)))
        V = source.standard_normal((order, order))
        whole = np.zeros((order, order))
        k = 0
        while k < order:
            if abs(np.imag(poles[-1 - k])) > 0:
                z = poles[-1 - k]
                whole[k : k + 2, k : k + 2] = [[z.real, z.imag], [-z.imag, z.real]]
                k += 2
            else:
                whole[k, k] = np.real(poles[-1 - k])
                k += 1
        A0, B0 = V @ whole @ np.linalg.inv(V), source.standard_normal((order, inputs))
        rows = source.standard_normal((outputs, order))
        T = np.array([rows[i] @ np.linalg.matrix_power(A0, j)
                      for i, length in enumerate(lengths) for j in range(length)])  # fmt: skip
        if np.linalg.cond(T) > 300:
            continue
        A, B = T @ A0 @ np.linalg.inv(T), T @ B0
        A1, B1 = np.zeros_like(A), 0.2 * B * source.standard_normal(B.shape)
        A1[ends] = 0.1 * A[ends] * source.standard_normal((outputs, order))
        if all(np.linalg.eigvals(A + z * A1).real.max() < -0.05 for z in np.linspace(-1, 1, 9)):
            return (A, A1), (B, B1), C


def at(plant, q):
    """A, B and C at a value of the parameter q in [1, 2]."""
    (A, A1), (B, B1), C = plant
    z = 2 * q - 3
    return A + z * A1, B + z * B1, C


def gains(A, B, C, frequency, D=0):
    """The frequency response, one frequency after the other."""
    n = len(A)
    rows = [C @ np.linalg.solve(1j * w * np.eye(n) - A, B) + D for w in frequency]
    return np.moveaxis(np.array(rows), 0, -1)


def names(plant):
    return {
        "input_names": [f"u{j}" for j in range(plant[1][0].shape[1])],
        "output_names": [f"y{i}" for i in range(len(plant[2]))],
    }


def in_frequency(plant, noise=0.0, source=None, points=POINTS):
    """Frequency responses at four values, each with relative noise."""
    found = []
    for q in points:
        G = gains(*at(plant, q), BAND)
        if noise:
            G = G * (1 + noise * (source.standard_normal(G.shape)
                                  + 1j * source.standard_normal(G.shape)))  # fmt: skip
        found.append(FrequencyResponse(BAND, G, {"q": q}, name=f"q = {q:g}", **names(plant)))
    return found


def integrated(A, B, C, time, u, x0):
    """The response to inputs that are straight between samples, by a solver of another kind."""

    def rate(t, x):
        return A @ x + B @ [np.interp(t, time, row) for row in u]

    return C @ solve_ivp(rate, time[[0, -1]], x0, t_eval=time, rtol=1e-10, atol=1e-12,
                         max_step=time[1]).y  # fmt: skip


def exactly(A, B, C, time, u, x0):
    """The same by the exponential of a larger matrix, sample after sample."""
    from scipy.linalg import expm

    n, m, T = len(A), B.shape[1], time[1] - time[0]
    zero = np.zeros((m, m))
    whole = np.block([[A, B, np.zeros((n, m))], [np.zeros((m, n)), zero, np.eye(m) / T],
                      [np.zeros((m, n)), zero, zero]])  # fmt: skip
    step = expm(whole * T)[:n]
    x = np.array(x0, dtype=float)
    rows = [C @ x]
    for k in range(len(time) - 1):
        x = step @ np.concatenate([x, u[:, k], u[:, k + 1] - u[:, k]])
        rows.append(C @ x)
    return np.array(rows).T


def in_time(plant, source, noise=0.0, count=900, step=0.1, points=POINTS):
    """Responses at four values, to smooth noise, from any state, each output off by a constant."""
    found = []
    for q in points:
        A, B, C = at(plant, q)
        time = np.arange(count) * step
        u = source.standard_normal((B.shape[1], count))
        for _ in range(3):
            u[:, 1:] = (u[:, 1:] + u[:, :-1]) / 2
        y = exactly(A, B, C, time, u, source.standard_normal(len(A)))
        y = y + noise * y.std(axis=1, keepdims=True) * source.standard_normal(y.shape)
        y = y + source.standard_normal((len(y), 1))
        found.append(Response(time, u, y, {"q": q}, name=f"q = {q:g}", **names(plant)))
    return found
