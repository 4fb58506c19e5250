"""Test vectors of exported code: inputs, and what the law makes of them.

They are written into the C test that ships with the code, and are the same for the same seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.export.program import (
    NUMBERS,
    Fixed,
    Polynomial,
    Program,
    Scheduled,
    Share,
    memory_of,
)
from polefence.export.sources import MARKER, Texts, context, environment
from polefence.law.laws import Law
from polefence.plant.parameters import simplex_weights
from polefence.plant.polynomial import binomial
from polefence.plant.system import Array
from polefence.proof.matrices import right_divide
from polefence.proof.short import Short

Bound = Callable[[Array], Array]
Flags = np.ndarray[Any, np.dtype[np.int64]]

# The flags of the C interface.
OK, CLAMPED, NOT_A_NUMBER, NO_CONTROL, LIMITED, RESTARTED, HELD_BACK = 0, 1, 2, 4, 8, 16, 32
# Largest error of u allowed, relative to sum_j |K_ij| |x_j|, by the bits of the number format.
ALLOWED = {32: 1e-5, 64: 1e-12}
SUM = 1e-3  # alpha whose sum is off by more is no rounding of a point of the simplex
Rationals = Any  # an array of Fractions, which numpy does not type
Whole = tuple[Any, int]  # numerators, and their denominator


@dataclass(frozen=True)
class Ends(Short):
    """Largest absolute value of each input, and how far it moves in an update; empty for none."""

    limits: tuple[float, ...] = ()
    steps: tuple[float, ...] = ()


FREE = Ends()


@dataclass(frozen=True, eq=False)
class Vectors:
    """Inputs of exported code, and the expected outputs.

    Attributes
    ----------
    given : (count, g) array
        Parameters or alpha; g is 0 for a fixed gain.
    x : (count, n) array
        As ``given``, numbers of the code's format; states that the code keeps last.
    last : (count, m) array
        What u was before, where the code keeps to a rate; else without columns.
    u : (count, m) array
        Of the law itself, the nearest doubles; last what the states become that the code keeps.
    scale : (count, m) array
        sum_j |K_ij| |x_j|, what errors of u are relative to; of a state its size, and that of its
        step, besides.
    flags : (count,) array of int
    """

    given: Array
    x: Array
    last: Array
    u: Array
    scale: Array
    flags: Flags


def vectors(
    program: Program, law: Law, ends: Ends = FREE, count: int = 64, seed: int = 0
) -> Vectors:
    """Return random vectors inside the set, of several magnitudes of x.

    Parameters
    ----------
    program : Program
        What the code computes; tells what it is given, in which format.
    law : Law
        What it was made of.
    ends : Ends
        Of the inputs.

    Raises
    ------
    InputError
        If the program is not that of a law of this kind and size.
    """
    random = np.random.default_rng(seed)
    given = program.number.nearest(_inside(program, random, count))
    magnitude = 10.0 ** random.integers(-3, 4, size=(count, 1))
    spread = 10.0 ** random.uniform(-1, 1, size=(count, program.shape[0]))
    x = program.number.nearest(magnitude * spread * random.choice([-1.0, 1.0], spread.shape))
    return _answered(program, law, ends, given, x)


def special(program: Program, law: Law, ends: Ends = FREE) -> Vectors:
    """Return vectors with NaN, infinity, and values outside the set, one fault or two in each.

    Raises
    ------
    InputError
        If the program is not that of a law of this kind and size.
    """
    n, _ = program.shape
    middle, faults = _faulty(program)
    plain = np.where(np.arange(n) % 2, -0.5, 1.0)
    rows = [(middle, plain), (middle, 0 * plain), (middle, 1e3 * plain)]
    rows += [(fault, plain) for fault in faults]
    # every state must be looked at; NaN and both infinities
    rows += [(middle, _with(plain, j, np.nan)) for j in range(n)]
    rows += [(middle, _with(plain, 0, np.inf)), (middle, _with(plain, n - 1, -np.inf))]
    given, x = (np.array(column) for column in zip(*rows, strict=True))
    return _answered(program, law, ends, program.number.nearest(given), x)


def _answered(program: Program, law: Law, ends: Ends, given: Array, x: Array) -> Vectors:
    """Return the vectors with the expected outputs."""
    limits = ends.limits
    finite = np.asarray(np.isfinite(x).all(axis=1))
    memory = memory_of(program)
    taken, flags = _taken(program, given)
    x = _off_limits(program, law, limits, taken, x)
    u, scale = expected(program, law, taken, np.where(finite[:, None], x, 0.0))
    flags = flags | np.where(finite, OK, NO_CONTROL)
    m = u.shape[1]
    if memory:
        states, m = x[:, -memory.states :], m - memory.states
        measured = np.asarray(np.isfinite(x[:, : -memory.states]).all(axis=1))
        kept = ~measured[:, None] & np.isfinite(states)  # where y is not finite
        before = np.where(finite[:, None], states, 0.0)
        after = np.where(kept, states, 0.0)
        u[:, m:] = np.where(finite[:, None], before + memory.step * u[:, m:], after)
        scale[:, m:] = np.abs(before) + memory.step * scale[:, m:]
        flags |= np.where(~finite & measured, RESTARTED, OK)
    cut, last = u[:, :m], np.zeros((len(u), 0))
    if limits:
        most = _limits(program, limits)
        flags = flags | np.where((np.abs(u[:, :m]) > most).any(axis=1), LIMITED, OK)
        cut = np.clip(cut, -most, most)
    if ends.steps:
        step = _limits(program, ends.steps)
        last = _before(program, cut, scale[:, :m], step)
        held = np.clip(cut, last - step, last + step)
        flags = flags | np.where((held != cut).any(axis=1), HELD_BACK, OK)
        scale[:, :m] = np.where(held != cut, np.abs(last) + step, scale[:, :m])
        cut = held
    if memory and law.anti_windup is not None and (limits or ends.steps):
        G = memory.step * law.anti_windup[-memory.states :, :m]
        u[:, m:] += np.where(finite[:, None], (cut - u[:, :m]) @ G.T, 0.0)
        beyond = np.where(cut == u[:, :m], 0.0, np.abs(cut) + np.abs(u[:, :m]) + scale[:, :m])
        scale[:, m:] += beyond @ np.abs(G).T
    u[:, :m] = cut
    return Vectors(given, x, last, u, scale, flags)


def _before(program: Program, u: Array, scale: Array, step: Array) -> Array:
    """Return what u was: within a step of it or farther, but not where rounding decides that."""
    shares = np.array([0.3, -0.4, 3.0, -2.5])[np.arange(len(u)) % 4, None]
    near = 4 * ALLOWED[program.number.bits] * (scale + np.abs(u))
    far = 100 * (step + near) * np.sign(shares)
    return program.number.nearest(u + np.where(near < 0.05 * step, shares * step, far))


def _off_limits(
    program: Program, law: Law, limits: tuple[float, ...], taken: Array, x: Array
) -> Array:
    """Return x halved where rounding would decide whether an input is cut."""
    if not limits:
        return x
    u, scale = expected(program, law, taken, np.where(np.isfinite(x), x, 0.0))
    m = len(limits)
    gap = np.abs(np.abs(u[:, :m]) - _limits(program, limits))
    near = (gap <= 4 * ALLOWED[program.number.bits] * scale[:, :m]) & (scale[:, :m] > 0)
    return np.where(np.any(near, axis=1, keepdims=True), x / 2, x)


def _limits(program: Program, limits: tuple[float, ...]) -> Array:
    """Return the limits as the code has them, rounded towards zero."""
    return np.array([program.number.outward(Fraction(v), up=False) for v in limits])


def _taken(program: Program, given: Array) -> tuple[Array, Flags]:
    """Return the inputs after the code's own substitutions, and its flags."""
    flags = np.zeros(len(given), dtype=np.int64)
    if isinstance(program, Fixed):
        return given, flags
    if not program.shares:
        return _taken_weights(given)
    low, high = _bounds(program.shares)
    missing = np.isnan(given)
    flags |= np.where(missing.any(axis=1), NOT_A_NUMBER, OK)
    flags |= np.where(((given < low) | (given > high)).any(axis=1), CLAMPED, OK)
    return np.where(missing, (low + high) / 2, np.clip(given, low, high)), flags


def _taken_weights(alpha: Array) -> tuple[Array, Flags]:
    positive = np.maximum(np.where(np.isfinite(alpha), alpha, 0.0), 0.0)
    total = positive.sum(axis=1)
    useless = ~np.isfinite(alpha).all(axis=1) | (total == 0)
    off = (alpha < -SUM).any(axis=1) | (np.abs(total - 1) > SUM)
    taken = np.where(useless[:, None], 1 / alpha.shape[1], positive)
    return taken, np.where(useless, NOT_A_NUMBER, np.where(off, CLAMPED, OK))


def _bounds(shares: tuple[Share, ...]) -> tuple[Array, Array]:
    return np.array([s.low for s in shares]), np.array([s.high for s in shares])


def _inside(program: Program, random: np.random.Generator, count: int) -> Array:
    """Return points of the set, every fourth value at an end or a vertex."""
    if isinstance(program, Fixed):
        return np.empty((count, 0))
    if program.shares:
        low, high = _bounds(program.shares)
        part = random.uniform(size=(count, len(low)))
        part = np.where(random.uniform(size=part.shape) < 0.25, np.round(part), part)
        return np.clip(low + part * (high - low), low, high)
    N = program.domain.corners
    vertices = np.eye(N)[random.integers(N, size=count)]
    at_vertex = random.uniform(size=(count, 1)) < 0.25
    return np.where(at_vertex, vertices, random.dirichlet(np.ones(N), size=count))


def _faulty(program: Program) -> tuple[Array, list[Array]]:
    """Return the middle of the set, and points with faults."""
    if isinstance(program, Fixed):
        return np.empty(0), []
    if not program.shares:
        return _faulty_weights(program.domain.corners)
    low, high = _bounds(program.shares)
    middle, width = (low + high) / 2, high - low
    faults = [low, high, np.full_like(low, np.nan)]
    for k in range(len(low)):
        values = (low[k] - width[k], high[k] + width[k], np.nan, np.inf, -np.inf)
        faults += [_with(middle, k, value) for value in values]
    if len(low) > 1:
        faults.append(_with(_with(middle, 0, np.nan), 1, high[1] + width[1]))
    return middle, faults


def _faulty_weights(N: int) -> tuple[Array, list[Array]]:
    middle, last = np.full(N, 1 / N), N - 1
    faults = [2 * middle, 0 * middle, _with(middle, 0, np.nan), _with(middle, last, np.inf)]
    return middle, [*faults, _with(middle, 0, middle[0] - 2), -middle]


def _with(values: Array, k: int, value: float) -> Array:
    changed = np.array(values, dtype=float)
    changed[k] = value
    return changed


def harness(
    program: Program, texts: Texts, law: Law, bound: Bound | None = None, seed: int = 0
) -> str:
    """Return the text of <name>_test.c: a program that compares the code with the law.

    Parameters
    ----------
    bound : function of x, optional
        What is proved of the error of u, (count, m) for x (count, n): where a sixteenth of it is
        larger than `ALLOWED`, that is what is allowed.

    Raises
    ------
    InputError
        If the program is not that of a law of this kind and size.
    """
    ends = Ends(texts.limits, texts.steps)
    tables = vectors(program, law, ends, seed=seed), special(program, law, ends)
    return (
        environment()
        .get_template("test.c.j2")
        .render(
            **context(program, texts),
            why_allowed=f"{ALLOWED[program.number.bits]:g} of that"
            + (", or a sixteenth of what is proved of rounding" if bound else ""),
            tables=[_rows(program, compared, bound) for compared in tables],
            odd=_odd(tables[1]),
        )
    )


def _rows(program: Program, table: Vectors, bound: Bound | None) -> list[dict[str, Any]]:
    allowed = ALLOWED[program.number.bits] * table.scale
    if bound is not None:
        off, memory = bound(np.where(np.isfinite(table.x), table.x, 0.0)), memory_of(program)
        if memory:
            off[:, -memory.states :] *= memory.sample_time  # of rates
        # a bound on rounding is a worst case: errors are some hundredths of it
        allowed = np.maximum(allowed, off / 16)
    return [_row(program, table, allowed, k) for k in range(len(table.x))]


def _row(program: Program, table: Vectors, allowed: Array, k: int) -> dict[str, Any]:
    """Return one vector as C constants, 0 in place of what is not finite."""
    double = NUMBERS[64]
    inputs = {"given": table.given[k], "x": table.x[k], "last": table.last[k]}
    outputs = {"u": table.u[k], "scale": table.scale[k], "allowed": allowed[k]}
    row: dict[str, Any] = {"flags": f"{table.flags[k]}U"}
    row |= {
        key: [program.number.text(v) for v in np.where(np.isfinite(values), values, 0.0)]
        for key, values in inputs.items()
    }
    return row | {key: [double.text(v) for v in values] for key, values in outputs.items()}


def _odd(table: Vectors) -> list[str]:
    """Return the places of values that are not finite, which a C99 table cannot hold."""
    lines = []
    for field, values in (("given", table.given), ("x", table.x)):
        for k, j in np.argwhere(~np.isfinite(values)):
            value = values[k, j]
            name = "not_a_number" if np.isnan(value) else "infinite"
            lines.append(f"[{k}].{field}[{j}] = {'-' if value < 0 else ''}{name};")
    return lines


def makefile(texts: Texts, observer: bool = False, board: bool = False) -> str:
    """Return the text of the Makefile that builds and runs the test, and drives on a board."""
    template = environment().get_template("Makefile.j2")
    return template.render(marker=MARKER, name=texts.name, observer=observer, board=board)


def expected(program: Program, law: Law, given: Array, x: Array) -> tuple[Array, Array]:
    """Return u of the law, exact to the rounding of the result, and sum_j |K_ij| |x_j|.

    `law.gain` alone would not do: where W is badly scaled it is less exact than the code.

    Parameters
    ----------
    given : (count, g) array
        Parameters, clamped to their intervals, or alpha, projected as by `law.gain` with ``clamp``.
    x : (count, n) array

    Returns
    -------
    u, scale : (count, m) arrays

    Raises
    ------
    InputError
        If the program is not that of a law of this kind and size.
    """
    if not _is_of(program, law):
        raise InputError(f"{law!r} is not the law of this code, which is {program.shape[::-1]}")
    if isinstance(program, Fixed) or law.W is None:
        gains = exact_gains(program, law, given)
        pairs = ((K, _rationals(v)) for K, v in zip(gains, x, strict=True))
        answers = [(_float(K @ v), _float(np.abs(K) @ np.abs(v))) for K, v in pairs]
    else:
        W, Z = (_whole(_rationals(M)) for M in np.split(law.form, [law.shape[1]], axis=1))
        alphas = [_alpha(program, values) for values in given]
        answers = [_at(law, Z, W, alpha, v) for alpha, v in zip(alphas, x, strict=True)]
    u, scale = (np.array(column) for column in zip(*answers, strict=True))
    return u, scale


def _is_of(program: Program, law: Law) -> bool:
    kind: type[Program] = Fixed if law.fixed else Polynomial if law.W is None else Scheduled
    shape = law.shape[0], law.C.shape[1]
    return isinstance(program, kind) and shape == program.shape[::-1]


def exact_gains(program: Program, law: Law, given: Array) -> Iterator[Rationals]:
    """Yield the exact gains at the code's inputs."""
    if isinstance(program, Polynomial) and law.gains is not None:
        K = _rationals(law.gains)
        for values in given:
            c = law.domain.coordinates(_alpha(program, values))
            c = c[1::2] - c[::2] if program.signed else c
            terms = [math.prod(c ** np.array(e)) for e in law.powers]
            yield np.tensordot(np.array(terms), K, 1)
        return
    if isinstance(program, Scheduled):
        form, n = _rationals(law.form), law.shape[1]
        for values in given:
            both = np.tensordot(_basis(law, _alpha(program, values)), form, 1)
            yield np.array(right_divide(both[n:].tolist(), both[:n].tolist()))
        return
    K = _rationals(law.own_gain(None))
    yield from (K for _ in given)


def _at(law: Law, Z: Whole, W: Whole, alpha: Rationals, x: Array) -> tuple[Array, Array]:
    """Return u and the scale of its error at one alpha and x."""
    many, unit = _whole(_basis(law, alpha))
    Z, W = ((np.tensordot(many, table, 1), unit * one) for table, one in (Z, W))
    K = law.gain(_float(alpha), clamp=True)
    return _float(_times(Z, _solved(W, _rationals(x)))), np.abs(K) @ np.abs(x)


def _basis(law: Law, alpha: Rationals) -> Rationals:
    """Return the values of the Bernstein polynomials."""
    c = law.domain.coordinates(alpha)
    basis = [
        math.prod((c[j] ** power for j, power in enumerate(e) if power), start=Fraction(many))
        for e in law.domain.monomials(law.degree)
        for many in [binomial(law.domain.sizes, e)]
    ]
    return np.array(basis)


def _whole(values: Rationals) -> Whole:
    """Return integers and their common denominator: many fractions take long to add."""
    denominator = math.lcm(*(value.denominator for value in values.flat))
    return np.vectorize(int, otypes=[object])(values * denominator), denominator


def _times(matrix: Whole, v: Rationals) -> Rationals:
    (left, unit), (right, other) = matrix, _whole(v)
    return (left @ right) * Fraction(1, unit * other)


def _solved(W: Whole, x: Rationals) -> Rationals:
    """Return W^-1 x: solved in doubles, corrected by the exact residual until nothing is left."""
    plain = _float(W[0] * Fraction(1, W[1]))
    size = np.sqrt(np.diagonal(plain))
    inverse = np.linalg.inv(plain / np.outer(size, size)) / np.outer(size, size)
    v = np.full(len(x), Fraction(0))
    # each leaves a part of 1e-6 or less, of any law worth exporting
    for _ in range(4):
        v = v + _rationals(inverse @ _float(x - _times(W, v)))
    return v


def _rationals(values: Array) -> Rationals:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(values, dtype=float))


def _float(values: Rationals) -> Array:
    return np.asarray(values, dtype=float)


def _alpha(program: Polynomial | Scheduled, given: Array) -> Rationals:
    """Return the vertices' weights as rationals: of parameters the product, the first slowest."""
    if not program.shares:
        weights = _rationals(np.maximum(given, 0.0))
        return np.asarray(weights / weights.sum())
    parameters = tuple(share.parameter for share in program.shares)
    values = {p.name: float(v) for p, v in zip(parameters, given, strict=True)}
    return np.array(simplex_weights(parameters, values, clamp=True))
