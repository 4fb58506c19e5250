"""A plant as a computer sees it: its samples, with inputs held between them, and late.

At a vertex they are those of the matrix exponential. Between vertices the exponential is no
combination of these: a polynomial of the parameters that has its values at Chebyshev's points, the
plant's curve, is added. What the exponential is then still off by falls off geometrically with the
degree; it is the plant's remainder, whose bound is evaluated in exact arithmetic and proved with
every design.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, require_type
from polefence.base.explained import explained
from polefence.plant.dead_time import on_time
from polefence.plant.family import SamplesOf, UncertainPlant
from polefence.plant.outputs import Output, inputs, states
from polefence.plant.parameters import exact
from polefence.plant.parts import ends, inside
from polefence.plant.samples import claim_of_samples
from polefence.plant.system import Array, System
from polefence.proof.between import MOST_IN_MIDDLES, Clock, Span
from polefence.proof.between import MOST_PARTS as MOST_CLOCK_PARTS
from polefence.proof.claims.base import prove
from polefence.proof.claims.samples import MAX_TERMS
from polefence.proof.claims.steps import FURTHER, products_of_series
from polefence.proof.plant import held_columns
from polefence.proof.remainder import MAX_CURVE, Kinks, Remainder, Rows
from polefence.proof.text import plural
from polefence.proof.work import FormatError
from polefence.response.discrete import balancing, zero_order_hold
from polefence.response.late import Late

# Of the largest change in a sample, which hardware makes larger. With ten times as much a car with
# an actuator and two sensors has no proof at 2 ms that its force stays 2 % below a limit.
ENOUGH = 1e-5
# Products in the series of one polynomial's remainder, beyond which samples are taken between
# nodes. A van's with an actuator and two sensors, three parameters, takes 1.9e7 at 0.5 ms: 7 s,
# and its laws of an order have no proof there on the whole box; between nodes both take 1 s.
LONG = 4e6
MOST_LOST = 16  # samples in a row
# By how much the fastest mode may turn in a part of a clock's periods. A van's rms at one corner
# for +-20 % at 4.8 ms is 2 % above the least in floats with 0.25, and has no proof with twice that.
TURNED = 0.25
# Of its own rate, by which others move a sensor, or an actuator them, in its unit: with all of it
# the samples of a van's law at 1.4 ms were "too long for these rates".
LITTLE = 2.0**-6
RATIO = 1.25  # of a part's longest period to its shortest: a spring's rms for +-20 % is then 1 %


@explained
def at_sample_time(
    plant: UncertainPlant,
    sample_time: Any,
    delay: Any = 0,
    degree: int | None = None,
    remainder: float = ENOUGH,
    jitter: Any = 0,
    lost: int = 0,
) -> UncertainPlant:
    """Return a plant's samples as a plant in discrete time, for designs at the sample time.

    Inputs and disturbances are held between samples.

    Parameters
    ----------
    plant : UncertainPlant
        In continuous time.
    sample_time : number
        T [s].
    delay : number
        How many samples late an input acts, whole or not: 1 where the law is computed during a
        step, 0.5 where that takes half of it. The inputs on their way are further states, so that
        a law may feed them back. A dead time of the plant's only input comes on top.
    degree : int, optional
        Of the samples as a polynomial of the parameters, 1 to 8: the higher, the smaller is the
        remainder, and the more is to be proved. By default, the lowest of which the remainder is
        small.
    remainder : float
        What is small beside what a sample changes, where no degree is given.
    jitter : number
        By what share of T each period may be longer or shorter; below 1.
    lost : int
        How many samples in a row may be lost: the input is held, and the law waits. With both, an
        rms is bounded for periods of (1 - jitter) T to (1 + lost) (1 + jitter) T in any order, and
        the loop is stable for them; all else is about samples T apart. An input that is 0.5 late
        acts half of T after its sample there, or after a later one, however long the period is.

    Returns
    -------
    UncertainPlant
        Its vertices are the samples of the plant's, to rounding; its ``remainder`` has the curve
        between them, and bounds what the samples of any plant of the family are off by. Every
        proof about it holds for all of those.

    Raises
    ------
    InputError
        If the plant is in discrete time, the sample time is not positive, or so long that the
        series of the exponential has too many terms.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    samples = sampled(plant, sample_time, delay, degree, remainder, jitter, lost)
    verdict = prove(claim_of_samples(samples))
    if not verdict.proved:
        every = float(samples.period)
        raise InputError(f"{samples.name} sampled every {every:g} s: {verdict.reason}")
    return samples


def sampled(
    plant: UncertainPlant,
    sample_time: Any,
    delay: Any = 0,
    degree: int | None = None,
    remainder: float = ENOUGH,
    jitter: Any = 0,
    lost: int = 0,
) -> UncertainPlant:
    """Return what `at_sample_time` returns before it is proved, which takes as long again.

    A file about it has the claim that it is samples, and is not proved without that.
    """
    T = _time(plant, sample_time)
    plant, late_by = on_time(plant)
    if plant.moving:
        raise InputError(
            f"parameter {plant.moving[0].name}: rate: samples are for constant parameters only; "
            "leave out rate, or the sample time"
        )
    late = Late.by(delay).after(late_by / T)
    counts = isinstance(degree, int) and not isinstance(degree, bool)
    if degree is not None and not (counts and 1 <= degree <= MAX_CURVE):
        raise InputError(f"degree = {degree!r} must be 1 to {MAX_CURVE}")
    clock = _clock(plant, T, jitter, lost)
    if clock is not None and late.early and clock.least <= 1 - late.early:
        raise InputError(
            f"delay = {delay!r}: with jitter = {float(1 - clock.least):g} the next sample may come "
            f"before an input acts; give less than {float(late.whole - 1 + clock.least):g}, or "
            f"{late.whole}"
        )
    held = _held(plant, T, late.early)
    bare, units = _on_the_way(plant, held, T, late), _units(plant)
    if plant.remainder is not None:
        if degree is not None:
            raise InputError(
                "degree: the samples of functions of the parameters are of no degree of one's own; "
                "leave it out"
            )
        return _with_clock(_between_nodes(plant, bare, units, late), clock)
    tried = _degrees(plant) if degree is None else [degree]
    curve, about = _chosen(plant, bare, units, late, tried, remainder * _change(held, units))
    try:
        most = LONG if degree is None and plant.parameters else math.inf
        samples = _with_remainder(plant, bare, units, late, curve, about, most)
    except FormatError as problem:
        if degree is not None or not plant.parameters:
            raise InputError(
                f"{plant.name} sampled every {float(T):g} s: {problem}; take a shorter sample time"
            ) from problem
        samples = _between_nodes(plant, bare, units, late)
    return _with_clock(samples, clock)


def _with_clock(samples: UncertainPlant, clock: Clock | None) -> UncertainPlant:
    """Return samples with their clock."""
    origin = samples.sampling
    return replace(samples, sampling=origin and replace(origin, clock=clock)) if clock else samples


def _columns(plant: UncertainPlant, delay: Late, states: int) -> list[int]:
    """Return the columns of [A, B], of so many states, of the inputs that act."""
    return held_columns(*plant.shape, delay.whole, delay.early, states)


def _doubled(plant: UncertainPlant, delay: Late, rows: Array) -> Array:
    """Return rows of [A, B, E], (..., n + m + q), the inputs' columns twice where two act."""
    if not delay.early:
        return rows
    n, m = plant.shape
    held = rows[..., n : n + m]
    return np.concatenate([rows[..., : n + m], held, rows[..., n + m :]], axis=-1)


def _clock(plant: UncertainPlant, T: Fraction, jitter: Any, lost: Any) -> Clock | None:
    """Return how far apart samples may be; None where that is always the same."""
    try:
        share = exact(jitter, "jitter")
    except PlantError as error:
        raise InputError(f"jitter = {jitter!r} must be a number, a share of the period") from error
    if isinstance(jitter, float):
        share = Fraction(repr(jitter))
    if not 0 <= share < 1:
        raise InputError(
            f"jitter = {float(share):g} must be at least 0 and below 1: by that share of it a "
            "period may be longer or shorter"
        )
    if not isinstance(lost, int) or isinstance(lost, bool) or not 0 <= lost <= MOST_LOST:
        raise InputError(f"lost = {lost!r} must be 0 to {MOST_LOST}, in samples")
    if not share and not lost:
        return None
    if not plant.parameters and len(plant.vertices) > 1:
        raise InputError(
            f"{plant.name} is given by its vertices; jitter and lost samples are for plants with "
            "parameters"
        )
    if not plant.disturbance_count:
        raise InputError(
            f"{plant.name} names no disturbance (no E); what jitter and lost samples cost is "
            "bounded by an rms, which needs one"
        )
    fastest, spans = float(np.abs(np.linalg.eigvals(plant.A)).max() * T), list[Span]()
    for periods in range(1, lost + 2):
        least, most = periods * (1 - share), periods * (1 + share)
        if spans and least <= spans[-1].most:
            least = spans.pop().least
        spans.append(Span(least, most))
    each = MOST_CLOCK_PARTS // len(spans)
    return Clock(tuple(replace(one, parts=_parts_of(one, fastest, each)) for one in spans))


def _parts_of(span: Span, fastest: float, most: int) -> int:
    """Return in how many parts periods are looked at, given the fastest rate over them."""
    turned = fastest * float(span.most - span.least) / TURNED
    longer = math.log(span.most / span.least) / math.log(RATIO)
    return max(1, min(most, math.ceil(max(turned, longer))))


def _degrees(plant: UncertainPlant) -> list[int]:
    """Return the degrees of interpolation worth trying; one vertex needs none."""
    if len(plant.vertices) == 1:
        return [1]
    return [d for d in (1, 2, 3, 4) if d == 1 or plant.domain.count(d) <= 125]  # coefficients


def _change(held: list[tuple[Array, Array, Array]], units: Array) -> float:
    """Return the largest change of the states in one sample, in the units."""
    n = len(held[0][0])
    steps = ((F - np.eye(n)) / units[:n, None] * units[:n] for F, *_ in held)
    return max(float(np.abs(M).max()) for M in steps)


def _chosen(
    plant: UncertainPlant,
    bare: UncertainPlant,
    units: Array,
    delay: Late,
    degrees: list[int],
    enough: float,
) -> tuple[Remainder, Array]:
    """Return a curve of the lowest sufficient degree, its remainder unknown, and its error."""
    n, width = bare.shape[0], sum(bare.shape) + plant.disturbance_count
    for degree in degrees:
        curve = _curve(plant, bare, delay, degree) if degree > 1 else ()
        wide = Remainder(((Fraction(1),) * width,) * n, curve, degree)
        about = _about(plant, replace(bare, remainder=wide), units, delay)
        if about.max() <= enough:
            break
    return wide, about


def _with_remainder(
    plant: UncertainPlant,
    bare: UncertainPlant,
    units: Array,
    delay: Late,
    wide: Remainder,
    about: Array,
    most: float,
) -> UncertainPlant:
    """Return the samples with a proved remainder; ``about`` is an estimate of its entries.

    Raises
    ------
    FormatError
        If its series takes more than the most products, or more than are computed at all.
    """
    (n, m), q = plant.shape, plant.disturbance_count
    terms = _terms(plant, delay, units, float(bare.sample_time or 0), about)
    sizes = plant.domain.sizes
    if products_of_series(len(plant.vertices), n, n + m + q, terms, sizes) > most:
        raise FormatError("the series has more terms than are worth it")
    origin = _origin(plant, delay, terms, units)
    exact, rest = claim_of_samples(replace(bare, remainder=wide, sampling=origin)).off()
    entries = np.array([[float(x) for x in row] for row in exact])
    # 1 % of room over what it has to hold
    rows = (entries + float(rest)) * 1.01 * units[:n, None] / _doubled(plant, delay, units)
    rounded = tuple(map(_up, _placed(rows, plant, bare, delay)))
    return replace(bare, remainder=replace(wide, entries=rounded), sampling=origin)


def _between_nodes(
    plant: UncertainPlant, bare: UncertainPlant, units: Array, delay: Late
) -> UncertainPlant:
    """Return the samples with the remainder of an interpolation, which is smaller on parts."""
    n = plant.shape[0]
    origin = _origin(plant, delay, 1, units)
    try:
        terms = claim_of_samples(replace(bare, sampling=origin)).terms_needed()
        origin = replace(origin, terms=terms)
        bounds = claim_of_samples(replace(bare, sampling=origin)).bounds()
    except FormatError as problem:
        raise InputError(f"{plant.name}: {problem}; take a shorter sample time") from problem
    scales = units[:n, None] / _doubled(plant, delay, units)
    along, third, kinks = (
        _doubled(plant, delay, np.array(matrices, dtype=float)) * 1.01
        if matrices
        else np.zeros((0, *scales.shape))
        for matrices in (bounds.along, bounds.third, bounds.kinks)
    )
    T = bare.sample_time or Fraction(0)
    known = np.abs([np.hstack(block) for block in _held(plant, T, delay.early)])
    largest = known.max(axis=0) / scales + along.sum(axis=0) / 8
    # with what rounding to doubles may change; of two inputs a difference is rounded
    missing = 2.02 * float(bounds.missing)
    remainders = [2.0**-51 * largest + missing, *along, *third, *kinks]
    rounding, *others = (
        tuple(map(_up, _placed(M * scales, plant, bare, delay))) for M in remainders
    )
    count, last = len(along), len(along) + len(third)
    bends, turns = others[:count], others[count:last] if count <= MOST_IN_MIDDLES else []
    of_functions = (
        Kinks(plant.functions, tuple(others[last:])) if len(kinks) and plant.functions else None
    )
    remainder = Remainder.between(rounding, bends, turns, of_functions)
    sampled = replace(bare, remainder=remainder, sampling=origin)
    vertices = inside(sampled, *ends(plant)).vertices
    return replace(sampled, vertices=vertices)


def _origin(plant: UncertainPlant, delay: Late, terms: int, units: Array) -> SamplesOf:
    exact_units = tuple(map(Fraction, units.tolist()))
    return SamplesOf(plant, delay.whole, terms, exact_units, early=delay.early)


def _placed(rows: Array, plant: UncertainPlant, bare: UncertainPlant, delay: Late) -> Array:
    """Return rows of x, inputs that act and w in the rows and columns of the samples' [A, B, E]."""
    n, q, states = plant.shape[0], plant.disturbance_count, bare.shape[0]
    acting = _columns(plant, delay, states)
    whole = np.zeros((states, sum(bare.shape) + q))
    whole[:n, :n], whole[:n, acting] = rows[:, :n], rows[:, n : n + len(acting)]
    whole[:n, sum(bare.shape) :] = rows[:, n + len(acting) :]
    return whole


def _curve(
    plant: UncertainPlant, bare: UncertainPlant, delay: Late, degree: int
) -> tuple[tuple[tuple[Fraction, ...], ...], ...]:
    """Return the Bernstein coefficients of the correction to the interpolated vertices."""
    domain = plant.domain
    coefficients = domain.interpolated(_apart(plant, bare, delay, domain.nodes(degree)), degree)
    # to 40 bits of the largest entry; 1e-300 stands for zero
    largest = np.maximum(np.abs(coefficients).max(axis=0), 1e-300)
    unit = 2.0 ** (np.floor(np.log2(largest)) - 40)
    rounded = (_placed(M, plant, bare, delay) for M in np.round(coefficients / unit) * unit)
    return tuple(tuple(tuple(map(Fraction, row.tolist())) for row in M) for M in rounded)


def _driven(plant: UncertainPlant, alpha: Array) -> Array:
    """Return E at points, (count, n, q); without columns where there is none."""
    if not plant.disturbance_count:
        return np.zeros((len(alpha), plant.shape[0], 0))
    return plant.driven(alpha)


def _time(plant: UncertainPlant, sample_time: Any) -> Fraction:
    if plant.sample_time is not None:
        raise InputError(
            f"{plant.name} is in discrete time already, every {float(plant.sample_time):g} s"
        )
    try:
        T = exact(sample_time, "sample_time")
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"sample_time = {sample_time!r} must be a number of seconds") from error
    if T <= 0:
        raise InputError(f"sample_time = {float(T):g} must be positive, in seconds")
    if isinstance(sample_time, float):  # 0.02 s, not the double next to it
        T = Fraction(repr(sample_time))
    return T


def _held(plant: UncertainPlant, T: Fraction, early: Fraction) -> list[tuple[Array, Array, Array]]:
    """Return F, G, H of every vertex; of inputs that change on the way G has the next behind."""
    m, matrices = plant.shape[1], []
    for vertex in plant.vertices:
        E = np.zeros((plant.shape[0], 0)) if vertex.E is None else vertex.E
        F, GH = zero_order_hold(vertex.A, np.hstack([vertex.B, E]), float(T))
        if not (np.all(np.isfinite(F)) and np.all(np.isfinite(GH))):
            raise InputError(
                f"{plant.name} outgrows floating point in a sample of {float(T):g} s; take a "
                "shorter one"
            )
        G = _changing(vertex.A, vertex.B, GH[:, :m], float(T * early)) if early else GH[:, :m]
        matrices.append((F, G, GH[:, m:]))
    return matrices


def _changing(A: Array, B: Array, G: Array, rest: float) -> Array:
    """Return what inputs do before they change, and the next for the rest of the period."""
    soon = zero_order_hold(A, B, rest)[1]
    return np.concatenate([G - soon, soon], axis=-1)


def _on_the_way(
    plant: UncertainPlant, held: list[tuple[Array, Array, Array]], T: Fraction, lateness: Late
) -> UncertainPlant:
    """Return the plant in discrete time, with the inputs on their way as states."""
    (n, m), delay = plant.shape, lateness.whole
    late = delay * m
    acting = _columns(plant, lateness, n + late)
    vertices = []
    for k, (F, G, H) in enumerate(held):
        both = np.zeros((n + late, n + late + m))
        both[:n, :n], both[:n, acting] = F, G
        if delay:
            both[n + m : n + late, n : n + late - m] = np.eye(late - m)
            both[n : n + m, n + late :] = np.eye(m)
        A, B = both[:, : n + late], both[:, n + late :]
        E = np.vstack([H, np.zeros((late, H.shape[1]))]) if H.shape[1] else None
        vertices.append(System(A, B, E, f"vertex {k + 1}"))  # type: ignore[arg-type]
    labels = [state.label for state in states(plant)]
    for j in range(1, delay + 1):
        ending = f", {plural(j, 'sample')} late"
        labels += [_label(signal.name + ending, signal.unit) for signal in inputs(plant)]
    return replace(
        plant,
        vertices=tuple(vertices),
        states=tuple(labels) if plant.states or delay else (),
        outputs=tuple(_late(plant, output, delay) for output in plant.every_output),
        sample_time=T,
        vehicle=None,
        remainder=None,
    )


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _late(plant: UncertainPlant, output: Output, delay: int) -> Output:
    """Return the output in terms of the delayed inputs, which are states."""
    C, D, F = output.exact(plant)
    F = F if plant.disturbance_count else ()
    n, m = plant.shape
    zeros = (Fraction(0),) * m
    if not delay:
        return replace(output, C=C, D=D, F=F)
    rows = [(*c, *zeros * (delay - 1), *d) for c, d in zip(C, D, strict=True)]

    def later(M: Rows) -> Rows:
        return tuple(
            (*row[:n], *zeros * (delay - 1), *row[n : n + m], *zeros, *row[n + m :]) for row in M
        )

    near = output.near and output.near.mapped(later)
    return replace(output, C=rows, D=[zeros for _ in rows], F=F, near=near)


def _units(plant: UncertainPlant) -> Array:
    """Return balancing units of states, inputs and disturbances, powers of two."""
    n = plant.shape[0]
    E = [np.zeros((n, 0)) if v.E is None else v.E for v in plant.vertices]
    A, B, H = np.abs(plant.A).max(axis=0), np.abs(plant.B).max(axis=0), np.abs(E).max(axis=0)
    speed = float(np.abs(np.linalg.eigvals(plant.A)).max()) or 1.0
    d = _balanced(A, speed)
    pushes = np.concatenate([B, H], axis=1) / d[:, None]
    size = np.linalg.norm(pushes, axis=0)
    acting = np.where(size > 0, speed / np.where(size > 0, size, 1.0), 1.0)
    return np.concatenate([d, 2.0 ** np.round(np.log2(acting))])


def _balanced(A: Array, speed: float) -> Array:
    """Return units of states of magnitudes A (n, n) that even out rows and columns, powers of two.

    A state that no other follows, as a sensor's, or that follows no other, as an actuator's, has no
    such unit: in its own the others move it, or it moves them, at a share of its own rate. Else its
    unit went off, and those of its neighbours: of a crane with sensors what a sample is rounded by
    was 3.7e-10 in place of 5e-15, and a limit that 2 parts of the box prove had no proof in any.
    """
    others, rest, apart = A - np.diag(np.diag(A)), list(range(len(A))), list[int]()
    while len(rest) > 1:
        inner = others[np.ix_(rest, rest)]
        alone = ~inner.any(axis=0) | ~inner.any(axis=1)
        if not alone.any():
            break
        apart.append(rest.pop(int(alone.argmax())))
    d = np.ones(len(A))
    d[rest] = balancing(A[np.ix_(rest, rest)][None])
    for i in reversed(apart):
        followed, moved = others[i, rest] @ d[rest], (others[rest, i] / d[rest]).sum()
        rate = LITTLE * (A[i, i] or speed)
        unit = followed / rate if followed else rate / moved if moved else 1.0
        d[i] = 2.0 ** np.round(np.log2(unit))
        rest.append(i)
    return d


def _about(plant: UncertainPlant, samples: UncertainPlant, units: Array, delay: Late) -> Array:
    """Return an estimate of the interpolation error, in the units, from a few points."""
    apart = _apart(plant, samples, delay, plant.domain.nodes(samples.curve_degree + 1))
    wide = _doubled(plant, delay, units)
    return np.asarray(np.abs(apart).max(axis=0) / units[: plant.shape[0], None] * wide)


def _apart(plant: UncertainPlant, samples: UncertainPlant, delay: Late, alpha: Array) -> Array:
    """Return the exact samples minus the interpolated ones at points alpha."""
    n, m = plant.shape
    A, B = plant.at(alpha)
    T = samples.sample_time or Fraction(0)
    F, GH = zero_order_hold(A, np.concatenate([B, _driven(plant, alpha)], axis=2), float(T))
    G = GH[..., :m]
    if delay.early:
        G = _changing(A, B, G, float(T * delay.early))
    held = np.concatenate([F, G, GH[..., m:]], axis=2)
    A, B = samples.at(alpha)
    acting = np.concatenate([A, B], axis=2)[:, :n, _columns(plant, delay, samples.shape[0])]
    computed = np.concatenate([A[:, :n, :n], acting, _driven(samples, alpha)[:, :n]], axis=2)
    return np.asarray(held - computed)


def _terms(plant: UncertainPlant, delay: Late, units: Array, T: float, about: Array) -> int:
    """Return how many terms make truncation small beside the interpolation error."""
    n = plant.shape[0]
    E = [np.zeros((n, 0)) if v.E is None else v.E for v in plant.vertices]
    M = T * np.concatenate([plant.A, plant.B, np.array(E)], axis=2) * units / units[:n, None]
    most = np.abs(M).max(axis=0)
    power, powers = most, [most]
    for k in range(2, MAX_TERMS + FURTHER):
        power = most[:, :n] @ power / k
        powers.append(power)
    left = _doubled(
        plant, delay, np.cumsum(powers[::-1], axis=0)[::-1]
    )  # of the k-th term and all behind it
    # terms are left out where they are 1 % of what entries are off by, or of the size of rounding
    enough = np.maximum(0.01 * about, 1e-13 * left[0])
    good = [bool(np.all(rest <= enough)) for rest in left]
    return min(good.index(True) if True in good else MAX_TERMS, MAX_TERMS) or 1


def _up(values: Array) -> tuple[Fraction, ...]:
    """Round up to numbers of few digits."""
    rounded = []
    for value in values.tolist():
        unit = Fraction(2) ** (math.frexp(value)[1] - 24)  # 24 bits
        rounded.append(math.ceil(Fraction(value) / unit) * unit if value else Fraction(0))
    return tuple(rounded)
