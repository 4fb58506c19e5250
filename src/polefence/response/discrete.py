"""Linear systems at sampling instants: exact discretisation, and many steps in few products.

Everything is batched over leading axes. Between samples the disturbance is held, or runs straight
from one sample to the next; under either the states at the samples are exact: the augmented
matrices are Van Loan's, IEEE Trans. Automat. Control 23 (1978) 395. Exponentials of many small
matrices at once are Higham's, SIAM J. Matrix Anal. Appl. 26 (2005) 1179: Pade approximant of
order 13 with scaling and squaring, here in coordinates balanced by powers of two, since states have
units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.late import Late
from polefence.response.weighting import positive

# Samples that one product covers, and bytes of the buffer that it reads.
BLOCK = 32
BUFFER = 16_000_000
PADE = tuple(
    math.factorial(26 - j) // (math.factorial(13 - j) * math.factorial(j)) for j in range(14)
)


@dataclass(frozen=True)
class Sampling(Short):
    """A controller that computes at multiples of ``period`` [s] and holds its demand between.

    Attributes
    ----------
    period : float
    delay : number
        How many samples after its own a demand goes out, whole or not: 1 is the next one, 0.5 the
        middle between both. Until the first goes out there is none.
    designed : bool
        Whether the law was designed for it: then it is in what is proved.
    """

    period: float
    delay: int | float | Fraction = 0
    designed: bool = False

    @explained_fields
    def __post_init__(self) -> None:
        positive(self.period, "sampling period [s]")
        Late.by(self.delay)

    @property
    def lateness(self) -> Late:
        """How late a demand goes out."""
        return Late.by(self.delay)


def zero_order_hold(A: Array, E: Array, h: float | Array) -> tuple[Array, Array]:
    """Return Phi, Gamma of x(t + h) = Phi x(t) + Gamma w, w held from t to t + h.

    Parameters
    ----------
    A : (..., n, n) array
    E : (..., n, q) array
    h : float or (...) array
        Step [s]; an array has one for every matrix.
    """
    A, E, h = _together(A, E, h)
    n, q = E.shape[-2:]
    M = np.zeros((*A.shape[:-2], n + q, n + q))
    M[..., :n, :n], M[..., :n, n:] = A * h, E * h
    F = exponential(M)[..., :n, :]
    return np.ascontiguousarray(F[..., :n]), np.ascontiguousarray(F[..., n:])


def first_order_hold(A: Array, E: Array, h: float | Array) -> tuple[Array, Array, Array]:
    """Return Phi, Gamma0, Gamma1 of x(t + h) = Phi x(t) + Gamma0 w(t) + Gamma1 w(t + h).

    Between t and t + h w runs straight from w(t) to w(t + h), as `scipy.signal.lsim` has it.

    Parameters
    ----------
    A : (..., n, n) array
    E : (..., n, q) array
    h : float or (...) array
        Step [s]; an array has one for every matrix.
    """
    A, E, h = _together(A, E, h)
    n, q = E.shape[-2:]
    M = np.zeros((*A.shape[:-2], n + 2 * q, n + 2 * q))
    M[..., :n, :n], M[..., :n, n : n + q] = A * h, E * h
    M[..., n : n + q, n + q :] = np.eye(q)
    F = exponential(M)[..., :n, :]
    Phi, level, slope = (np.ascontiguousarray(X) for X in np.split(F, [n, n + q], axis=-1))
    return Phi, level - slope, slope


def _together(A: Array, E: Array, h: float | Array) -> tuple[Array, Array, Array]:
    A, E = np.asarray(A, dtype=float), np.asarray(E, dtype=float)
    step = np.asarray(h, dtype=float)
    lead = np.broadcast_shapes(A.shape[:-2], E.shape[:-2], step.shape)
    return (
        np.broadcast_to(A, (*lead, *A.shape[-2:])),
        np.broadcast_to(E, (*lead, *E.shape[-2:])),
        step[..., None, None],
    )


def free_response(Phi: Array, C: Array, start: Array, samples: int) -> Array:
    """Return y_k = C x_k of x_{k+1} = Phi x_k, (count, samples, p).

    Parameters
    ----------
    Phi : (count, n, n) array
    C : (count, p, n) array
    start : (count, n) array
        x_0.
    samples : int

    Raises
    ------
    InputError
        If the response outgrows floating point.
    """
    nothing = np.zeros((len(Phi), Phi.shape[-1], 0))
    return forced_response(Phi, nothing, C, C @ nothing, np.zeros((samples, 0)), start)


def forced_response(
    Phi: Array,
    Gamma: Array,
    C: Array,
    D: Array,
    w: Array,
    start: Array | None = None,
    Gamma1: Array | None = None,
) -> Array:
    """Return y_k = C x_k + D w_k of x_{k+1} = Phi x_k + Gamma w_k (+ Gamma1 w_{k+1}).

    `BLOCK` samples are one product: with x at its first sample and w in it known, a block of y is
    linear in both, by the same matrix for all blocks of one system. Apart from the result, (count,
    T, p), only small arrays are made.

    Parameters
    ----------
    Phi : (count, n, n) array
    Gamma, Gamma1 : (count, n, q) array
    C : (count, p, n) array
    D : (count, p, q) array
    w : (T, q) array
        Common to all systems.
    start : (count, n) array, optional
        x_0; zero by default.

    Raises
    ------
    InputError
        If the response outgrows floating point.
    """
    count, n = Phi.shape[:2]
    (T, q), p = w.shape, C.shape[-2]
    z = np.zeros((count, n)) if start is None else np.broadcast_to(start, (count, n))
    if Gamma1 is not None:
        # z = x - Gamma1 w needs no w of the next sample.
        z = z - Gamma1 @ w[0] if T else z
        Gamma, D = Gamma + Phi @ Gamma1, D + C @ Gamma1
    values = np.empty((count, T, p))
    if not values.size:
        return values
    L = max(1, min(BLOCK // max(q, 1), T))
    blocks = -(-T // L)
    padded = np.zeros((blocks * L, q))
    padded[:T] = w
    inputs = padded.reshape(blocks, L * q)
    group = int(max(1, min(count, BUFFER // (8 * blocks * (n + L * q)))))
    buffer = np.empty((group, blocks, n + L * q))
    buffer[:, :, n:] = inputs
    with np.errstate(over="ignore", invalid="ignore"):
        for first in range(0, count, group):
            part = slice(first, min(first + group, count))
            known = buffer[: part.stop - first]
            tables = _tables(Phi[part], Gamma[part], C[part], D[part], L)
            known[:, :, :n] = _first_states(tables, z[part], inputs)
            _blocks(known, tables[0], values[part])
            _require_finite(values[part, -1])
    return values


def _tables(Phi: Array, Gamma: Array, C: Array, D: Array, L: int) -> tuple[Array, Array, Array]:
    """Return the matrices of a block: [x, w] to y in it, w to the next x, x to the next x.

    Row vectors: (count, n + L q, L p), (count, L q, n), (count, n, n).
    """
    (count, n, q), p = Gamma.shape, C.shape[-2]
    powers = np.empty((count, L + 1, n, n))
    powers[:, 0], powers[:, 1] = np.eye(n), Phi
    done = 2
    while done <= L:
        more = min(done, L + 1 - done)
        powers[:, done : done + more] = powers[:, :more] @ (powers[:, done - 1] @ Phi)[:, None]
        done += more
    outputs = C[:, None] @ powers[:, :L]
    # Markov parameters after L - 1 zeros: the Toeplitz matrix is a view of them.
    markov = np.zeros((count, 2 * L - 1, p, q))
    markov[:, L - 1] = D
    markov[:, L:] = outputs[:, : L - 1] @ Gamma[:, None]
    table = np.empty((count, n + L * q, L * p))
    table[:, :n] = outputs.transpose(0, 3, 1, 2).reshape(count, n, L * p)
    toeplitz = table[:, n:].reshape(count, L, q, L, p)
    for i in range(L):
        toeplitz[:, i] = markov[:, L - 1 - i : 2 * L - 1 - i].transpose(0, 3, 1, 2)
    into = (powers[:, L - 1 :: -1] @ Gamma[:, None]).transpose(0, 1, 3, 2).reshape(count, L * q, n)
    return table, into, powers[:, L].swapaxes(-1, -2)


def _first_states(tables: tuple[Array, Array, Array], start: Array, inputs: Array) -> Array:
    """Return x at the first sample of every block, (count, blocks, n).

    Rows of about sqrt(blocks) blocks advance side by side from zero, then carry into one another.
    """
    _, into, over = tables
    count, n = start.shape
    blocks = len(inputs)
    width = max(1, math.isqrt(blocks))
    rows = -(-blocks // width)
    flat = np.zeros((count, rows * width, n))
    np.matmul(inputs, into, out=flat[:, :blocks])
    added = flat.reshape(count, rows, width, n)
    states = np.zeros((count, rows, width, n))
    power = np.empty((count, width + 1, n, n))
    power[:, 0] = np.eye(n)
    for k in range(width):
        power[:, k + 1] = power[:, k] @ over
        if k + 1 < width:
            states[:, :, k + 1] = states[:, :, k] @ over + added[:, :, k]
    last = states[:, :, -1] @ over + added[:, :, -1]
    carried = np.empty((count, rows, n))
    carried[:, 0] = start
    for j in range(rows - 1):
        carried[:, j + 1] = (carried[:, j, None] @ power[:, width])[:, 0] + last[:, j]
    joined = power[:, :width].transpose(0, 2, 1, 3).reshape(count, n, width * n)
    states += (carried @ joined).reshape(count, rows, width, n)
    firsts = states.reshape(count, rows * width, n)[:, :blocks]
    _require_finite(firsts)
    return firsts


def _require_finite(values: Array) -> None:
    if not np.all(np.isfinite(values)):
        raise InputError("the response outgrows floating point; the loop is unstable, end earlier")


def _blocks(known: Array, table: Array, values: Array) -> None:
    """Fill values (count, T, p) block by block: known (count, blocks, .) times the table."""
    count, T, p = values.shape
    L = table.shape[-1] // p
    whole = T // L
    # A view: the samples of a block, and their signals, lie side by side.
    full = values[:, : whole * L].reshape(count, whole, L * p)
    np.matmul(known[:, :whole], table, out=full)
    rest = T - whole * L
    if rest:
        values[:, whole * L :] = (known[:, whole:] @ table[:, :, : rest * p]).reshape(
            count, rest, p
        )


def exponential(M: Array) -> Array:
    """Return e^M of finite (..., n, n) matrices, NaN where it outgrows floating point."""
    M = np.asarray(M, dtype=float)
    if M.size == 0:
        return M.copy()
    shape, M = M.shape, M.reshape(-1, *M.shape[-2:])
    d = balancing(M)
    M = M * (d[None, :] / d[:, None])
    norm = np.abs(M).sum(axis=-2).max(axis=-1)
    # Higham's bound on the 1-norm up to which the approximant of order 13 is exact but for rounding
    squarings = np.ceil(np.log2(np.maximum(norm / 5.371920351148152, 1.0))).astype(int)
    E = _pade(M * 2.0 ** -squarings[:, None, None])
    with np.errstate(over="ignore", invalid="ignore"):
        for done in range(squarings.max()):
            more = squarings > done
            if more.all():
                E = E @ E
            else:
                E[more] = E[more] @ E[more]
        return np.asarray(E * (d[:, None] / d[None, :])).reshape(shape)


def balancing(M: Array) -> Array:
    """Return powers of two d (n,) that even out diag(d)^-1 M diag(d) of all M (count, n, n)."""
    largest = np.abs(M).max(axis=0)
    n, diagonal = len(largest), np.diagonal(largest).max()
    # What nothing follows, or follows nothing, as a disturbance or a weight: made small beside the
    # rest, and no smaller, sweep after sweep.
    small = 1e-6 * float(diagonal or largest.max())
    if not (small > 1e-150 and largest.max() < 1e150):  # also where entries are no numbers
        return np.ones(n)
    np.fill_diagonal(largest, 0.0)
    size, d = largest.tolist(), [1.0] * n  # plain numbers: n is small
    for _ in range(60):  # sweeps at most: a chain of 8 states takes 30
        even = True
        for i in range(n):
            column, row, share = sum(line[i] for line in size), sum(size[i]), 0.5
            if not column or not row:  # all the way, for nothing else moves it
                column, row, share = max(column, small), max(row, small), 1.0
            f = 2.0 ** round(share * math.log2(row / column))
            if f != 1:
                even = False
                d[i] *= f
                size[i] = [entry / f for entry in size[i]]
                for line in size:
                    line[i] *= f
        if even:
            break
    return np.array(d)


def _pade(M: Array) -> Array:
    eye = np.eye(M.shape[-1])
    b = PADE
    M2 = M @ M
    M4 = M2 @ M2
    M6 = M4 @ M2
    odd = M6 @ (b[13] * M6 + b[11] * M4 + b[9] * M2)
    odd = M @ (odd + b[7] * M6 + b[5] * M4 + b[3] * M2 + b[1] * eye)
    even = M6 @ (b[12] * M6 + b[10] * M4 + b[8] * M2)
    even = even + b[6] * M6 + b[4] * M4 + b[2] * M2 + b[0] * eye
    return np.asarray(np.linalg.solve(even - odd, even + odd))
