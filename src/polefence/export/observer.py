"""Observer in C99 beside the law: its text, its step from tick to tick, the sampled loop.

The code steps x^' = A x^ + B u + L (y - C x^) by the sample time, u and y held, with the Taylor
series of order 4: for a constant alpha the Runge-Kutta method of that order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.certify.design import Design
from polefence.export.program import LEAST, MOST, Number, Scheduled, program
from polefence.export.sources import Texts, check_c_name, context, environment, rows, weighing
from polefence.law.laws import FixedGain, ScheduledGain, check_alpha
from polefence.plant.parameters import Parameter
from polefence.plant.points import sample
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array, Exact
from polefence.proof.short import Short
from polefence.region.text import short_text
from polefence.response.discrete import zero_order_hold
from polefence.search.observer import Observer

LONGEST = 20  # characters: C tells external names apart by 31

ORDER = 4
# |pole| times sample time. In the left half-plane the step then errs by less than 1 % of the state
# and its pole by less than 2 %; y, held over the step, is then the coarser part.
ACCURATE = 1.0
# Without measurements the step is the plant's own: of order 4 it is stable where the plant is as
# long as |pole| times sample time is below 2.6, in every direction of the left half-plane.
STABLE = 2.6


def observer_sources(
    observer: Observer,
    number: Number,
    texts: Texts,
    parameters: tuple[Parameter, ...],
    sample_time: float | None,
) -> dict[str, str]:
    """Return the observer's header and source, by the files' names; they include the law's header.

    Parameters
    ----------
    observer : Observer
    number : Number
        The law's.
    texts : Texts
        The law's: the observer's files and functions are called ``<name>_observer``.
    parameters : tuple of Parameter
        What the code is given; empty for alpha itself. A plant of one vertex needs neither.
    sample_time : float, optional
        From one update to the next [s]; in discrete time the plant's own, or None.

    Raises
    ------
    InputError
        If the sample time is too long for the observer, a name is too long for C, the texts are of
        another plant, or a number is out of the format's range.
    """
    check_c_name(texts.name)
    if len(texts.name) > LONGEST:
        raise InputError(
            f"name = {texts.name!r} is too long for the functions of an observer; use at most "
            f"{LONGEST} characters"
        )
    shape = len(texts.states), len(texts.inputs)
    if shape != observer.plant.shape:
        raise InputError(
            f"{shape[0]} states and {shape[1]} inputs are named; the observer's plant has "
            f"{observer.plant.shape[0]} and {observer.plant.shape[1]}"
        )
    step = check_sample_time(observer, sample_time)
    templates = environment()
    given = _context(observer, number, texts, parameters, step)
    return {
        f"{texts.name}_observer.{ending}": templates.get_template(f"observer.{ending}.j2").render(
            given
        )
        for ending in "hc"
    }


def _context(
    observer: Observer,
    number: Number,
    texts: Texts,
    parameters: tuple[Parameter, ...],
    sample_time: float,
) -> dict[str, Any]:
    discrete = observer.plant.sample_time is not None
    p, n = observer.C.shape[1:]
    gain, carrier = _programs(observer, parameters, number)
    tables, varying = _plant_tables(observer, number, carrier)
    L = np.zeros((n, p)) if gain is not None else _constant_gain(observer)
    tables.append(rows(number, _held(number.nearest(L), "L")))
    over = [number.text(float(v)) for v in number.nearest(sample_time / np.arange(1, ORDER + 1))]
    return _common(observer, number, texts, carrier) | {
        "equation": f"{'x^(next)' if discrete else 'd/dt x^'} = A x^ + B u + L (y - C x^),",
        "claim": _claim(observer),
        "measured": observer.design.plant.inputs or [f"measured signal {j + 1}" for j in range(p)],
        "sample_time": over[0],
        "discrete": discrete,
        "over": over,
        "still": [number.text(0.0)] * p,
        "nothing": [number.text(0.0)] * n,
        "tables": tables,
        "varying": varying,
        **_gain_tables(number, gain),
    }


def _common(
    observer: Observer, number: Number, texts: Texts, carrier: Scheduled | None
) -> dict[str, Any]:
    """Return the context shared with the law's template, with the observer's names."""
    named = replace(texts, name=f"{texts.name}_observer", limits=())
    real, NAME = f"{texts.name}_real", named.name.upper()
    arguments = [
        f"{named.name} *observer",
        f"const {real} u[{texts.name.upper()}_INPUTS]",
        f"const {real} y[{NAME}_MEASURED]",
    ]
    if carrier is None:
        none = program(FixedGain(np.zeros(observer.plant.shape[::-1])), (), number)
        common = context(none, named)
    else:
        common = context(carrier, named) | {"weighing": weighing(carrier, real)}
        arguments.insert(1, f"const {real} {common['letter']}[{NAME}_{common['GIVEN']}]")
    return common | {"law": texts.name, "LAW": texts.name.upper(), "arguments": arguments}


def _gain_tables(number: Number, gain: Scheduled | None) -> dict[str, Any]:
    if gain is None:
        return {"gain_T": [], "gain_W": [], "gain_Z": []}
    lower = np.tril_indices(gain.shape[0])
    return {
        "gain_T": [number.text(v) for v in gain.T[lower]],
        "gain_W": rows(number, gain.W[:, lower[0], lower[1]].T),
        "gain_Z": rows(number, gain.Z.reshape(len(gain.Z), -1).T),
    }


def _constant_gain(observer: Observer) -> Array:
    return observer.gain([1.0])  # of one vertex, or of all


def _programs(
    observer: Observer, parameters: tuple[Parameter, ...], number: Number
) -> tuple[Scheduled | None, Scheduled | None]:
    """Return the program of a scheduled gain, and one that finds alpha's polynomials.

    A fixed gain has no program of its own, and a plant of one vertex needs no alpha.
    """
    law, N = observer.design.law, len(observer.plant.vertices)
    if N == 1:
        return None, None
    if law.K is not None:
        n = observer.plant.shape[0]
        law = ScheduledGain(np.stack([np.eye(n)] * N), np.zeros((N, 1, n)), parameters)
        made = program(law, parameters, number)
        return None, made if isinstance(made, Scheduled) else None
    made = program(law, parameters, number)
    return (made, made) if isinstance(made, Scheduled) else (None, None)


def _plant_tables(
    observer: Observer, number: Number, carrier: Scheduled | None
) -> tuple[list[list[list[str]]], list[dict[str, Any]]]:
    """Return A, B, C with the entries that do not depend on alpha, and the others."""
    vertices = observer.plant.vertices
    matrices: dict[str, Sequence[Exact]] = {
        "a": [v.exact_A for v in vertices],
        "b": [v.exact_B for v in vertices],
        "c": observer.exact_C,
    }
    tables, varying = [], list[dict[str, Any]]()
    for letter, corner_matrices in matrices.items():
        table = []
        for i in range(len(corner_matrices[0])):
            line = []
            for j in range(len(corner_matrices[0][0])):
                corners = [M[i][j] for M in corner_matrices]
                same = all(value == corners[0] for value in corners)
                line.append(corners[0] if same else Fraction(0))
                if not same and carrier is not None:
                    row = _constants(number, _coefficients(carrier, corners), letter)
                    varying.append({"place": f"{letter}[{i}][{j}]", "row": row})
            table.append(_constants(number, line, letter))
        tables.append(table)
    return tables, varying


def _coefficients(carrier: Scheduled, corners: list[Fraction]) -> list[Fraction]:
    """Return the Bernstein coefficients, in the law's degree, of what is affine in alpha."""
    domain, degree = carrier.domain, carrier.degree
    terms = zip(domain.monomials(degree), domain.elevated(1, degree - 1), strict=True)
    return [
        sum((weight * corners[j] for j, weight in row.items()), Fraction(0))
        / binomial(domain.sizes, exponent)
        for exponent, row in terms
    ]


def _constants(number: Number, values: list[Fraction], letter: str) -> list[str]:
    floats = number.nearest(np.array([float(v) for v in values]))
    return [number.text(float(v)) for v in _held(floats, letter.upper())]


def _held(values: Array, what: str) -> Array:
    size = np.abs(values[values != 0])
    if size.size and not size.max() <= MOST:
        raise InputError(
            f"{what} of the observer: numbers reach {size.max():.3g}, too large for the code; "
            "choose units in which states, inputs and measured signals are nearer to one"
        )
    return np.where(np.abs(values) < LEAST**2, 0.0, values)


def _claim(observer: Observer) -> list[str]:
    region = short_text(observer.region)
    proved = "Proved" if observer.design.proved else "NOT PROVED"
    lines = [
        f"{proved}: all poles of A - L C lie in {region} whatever the parameters, kept",
        "constant, and known to this code.",
    ]
    if observer.plant.sample_time is None:
        lines += [
            "That is about the differential equation; here y and u are held over a sample time,",
            f"and it is stepped by the Taylor series of order {ORDER}.",
        ]
    return [*lines, "Nothing is proved of this code's rounding."]


def check_sample_time(observer: Observer, sample_time: float | None) -> float:
    """Return the sample time of an observer's steps [s].

    Raises
    ------
    InputError
        If it is no positive number, not the plant's own in discrete time, or too long: some
        |pole| of A - L C times it is beyond 1, or of A beyond 2.6, over the family as sampled.
    """
    T = observer.plant.sample_time
    if T is not None:
        if sample_time is not None and sample_time != float(T):
            raise InputError(
                f"sample_time = {sample_time!r}: {observer.plant.name} is in discrete time, and "
                f"its own is {float(T):g} s; leave sample_time out"
            )
        return float(T)
    number = isinstance(sample_time, int | float) and not isinstance(sample_time, bool)
    if sample_time is None or not number or not LEAST < sample_time < MOST:
        raise InputError(
            f"sample_time = {sample_time!r} must be a positive number of seconds: the observer's "
            "code steps by it"
        )
    for fastest, bound, whose in _bounds(observer):
        if fastest * sample_time > bound:
            raise InputError(
                f"sample_time = {sample_time:g} s is too long for the observer: {whose} of "
                f"magnitude {fastest:.3g} 1/s, and a step of order {ORDER} bears {bound:g} over "
                f"that; use at most {_down(bound / fastest)} s"
            )
    return float(sample_time)


def longest_sample_time(observer: Observer) -> float:
    """Return the longest sample time that `check_sample_time` takes [s]; without end, infinity."""
    limits = [bound / fastest for fastest, bound, _ in _bounds(observer) if fastest > 0]
    return float(min(limits, default=math.inf))


def _bounds(observer: Observer) -> list[tuple[float, float, str]]:
    alpha = family_points(observer)
    fastest = np.abs(np.linalg.eigvals(observer.plant.at(alpha)[0])).max()
    return [
        (float(np.abs(observer.poles(alpha)).max()), ACCURATE, "the observer has a pole"),
        (float(fastest), STABLE, "the plant, which it follows where y is missing, has a pole"),
    ]


def _down(value: float) -> str:
    """Print a positive number in three digits, rounded down."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.floor(value / scale) * scale:.3g}"


def family_points(observer: Observer) -> Array:
    """Return samples alpha of the family, (count, N): corners, edges and a seeded sample.

    Where the plant has parameters they are products, as alpha of parameters is.
    """
    N = len(observer.plant.vertices)
    law = observer.design.law
    box = bool(observer.plant.parameters) or law.domain.on == "box"
    domain = Domain.of("box" if box else "simplex", N)
    return check_alpha(domain.alpha(sample(domain)), N)


def observer_step(
    observer: Observer, alpha: Any, sample_time: float | None = None, measured: bool = True
) -> tuple[Array, Array, Array]:
    """Return the matrices of the code's step in double precision.

    Parameters
    ----------
    observer : Observer
    alpha : (..., N) array
    sample_time : float, optional
        [s]; None in discrete time.
    measured : bool
        False for the step where y has NaN or infinity.

    Returns
    -------
    Phi : (..., n, n) array
    Gamma : (..., n, m) array
    Lambda : (..., n, p) array
        The next estimate is Phi x^ + Gamma u + Lambda y, y being measured at the end of the step;
        in discrete time at its start.

    Raises
    ------
    InputError
        As `check_sample_time` does.
    """
    h = check_sample_time(observer, sample_time)
    A, B, C, L = _matrices(observer, alpha)
    L = L if measured else np.zeros_like(L)
    M = A - L @ C
    if observer.plant.sample_time is not None:
        return M, B, L
    one = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    series = one
    for k in range(ORDER, 1, -1):
        series = one + (h / k) * (M @ series)
    series = h * series
    return one + M @ series, series @ B, series @ L


def _matrices(observer: Observer, alpha: Any) -> tuple[Array, Array, Array, Array]:
    a = check_alpha(alpha, len(observer.plant.vertices))
    A, B = observer.plant.at(a)
    L = np.broadcast_to(observer.gain(a), (*A.shape[:-1], observer.C.shape[1]))
    return A, B, np.tensordot(a, observer.C, 1), L


@explained
def sampled_output_loop(
    design: Design,
    observer: Observer,
    alpha: Any,
    sample_time: float | None = None,
    *,
    delay: int = 0,
) -> Array:
    """Return the eigenvalues of plant, law and observer from tick to tick, as they run.

    At every tick y is measured, the estimate updated, and u = K x^ computed: applied at once, or
    with ``delay`` 1 from the next tick on. The plant is discretised exactly with u held.

    Parameters
    ----------
    design : Design
        State feedback of the observer's plant.
    observer : Observer
    alpha : (..., N) array
        Constant, and the same for all three.
    sample_time : float, optional
        [s]; None in discrete time.
    delay : int
        0 or 1 sample times.

    Returns
    -------
    (..., k) array
        The loop is stable where all are below one in magnitude. k is 2 n, and m more with delay.

    Raises
    ------
    InputError
        If the design is of another plant, the delay neither 0 nor 1, or the sample time too long.
    """
    return np.asarray(np.linalg.eigvals(_loop(design, observer, alpha, sample_time, delay)))


def _loop(
    design: Design, observer: Observer, alpha: Any, sample_time: float | None, delay: int
) -> Array:
    observer.feedback(design)  # refuses another plant's
    if delay not in (0, 1):
        raise InputError(f"delay = {delay!r} must be 0 or 1 sample times")
    h = check_sample_time(observer, sample_time)
    Phi, Gamma, Lambda = observer_step(observer, alpha, sample_time)
    A, B, C, _ = _matrices(observer, alpha)
    a = check_alpha(alpha, len(observer.plant.vertices))
    K = np.broadcast_to(design.law.gain(a), (*A.shape[:-2], B.shape[-1], A.shape[-1]))
    if observer.plant.sample_time is None:
        F, G = zero_order_hold(A, B, h)
        seen = Lambda @ C @ F, Lambda @ C @ G
    else:
        F, G = A, B
        seen = Lambda @ C, np.zeros_like(G)
    Gamma = Gamma + seen[1]
    if delay:
        zero = np.zeros_like(F)
        still = np.zeros((*A.shape[:-2], B.shape[-1], B.shape[-1]))
        none = np.zeros_like(K)
        return np.block([[F, zero, G], [seen[0], Phi, Gamma], [none, K, still]])
    return np.block([[F, G @ K], [seen[0], Phi + Gamma @ K]])


@dataclass(frozen=True, eq=False)
class SampledLoop(Short):
    """Sampled loop over a family, at sampled alphas; no proof.

    Attributes
    ----------
    largest : float
        Magnitude of the largest eigenvalue found.
    decay : float
        The slowest decay found, -log(largest) / sample time [1/s]; below zero it is unstable.
    alpha : (N,) array
        Where it was found.
    points : int
        How many alphas were tried.
    """

    largest: float
    decay: float
    alpha: Array
    points: int

    @property
    def stable(self) -> bool:
        """Whether all eigenvalues found are below one in magnitude."""
        return self.largest < 1


@explained
def judge_sampled_loop(
    design: Design, observer: Observer, sample_time: float | None = None, *, delay: int = 0
) -> SampledLoop:
    """Look for the largest eigenvalue of `sampled_output_loop` over the family.

    Raises
    ------
    InputError
        As `sampled_output_loop` does.
    """
    h = check_sample_time(observer, sample_time)
    alpha = family_points(observer)
    sizes = np.abs(sampled_output_loop(design, observer, alpha, sample_time, delay=delay))
    sizes = sizes.max(axis=-1)
    worst = int(sizes.argmax())
    largest = float(sizes[worst])
    decay = math.inf if largest == 0 else -math.log(largest) / h
    return SampledLoop(largest, decay, alpha[worst], len(alpha))
