"""The law in the loop, on an emulated microprocessor: drives over random roads, as a C program.

The plant runs in doubles beside the exported code, by matrices of the exponential from one instant
to the next. Where an input acts late by a part of a period, this has two phases, each with instants
of its own. Its noise is white in continuous time: what an interval adds to the states has the
covariance that Van Loan's block exponential says. So the rms that is measured has no error but
that of a drive of finite length, and no step of a solver. It is measured between samples too: the
mean over a period is that of Simpson's rule at instants that the loop's fastest pole sets.

It is driven where each promised rms is worst among corners and random points of the family.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.design import Design
from polefence.export.memory import kept, late_inputs
from polefence.export.program import NUMBERS, Fixed, Program
from polefence.export.sampled import cloud, stepped
from polefence.export.sources import MARKER, Texts, comment, context, environment
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at, where_text
from polefence.plant.system import Array
from polefence.proof.claims.base import Claim
from polefence.proof.claims.rms import Rms
from polefence.proof.short import Short
from polefence.requirements.weights import filter_of, named
from polefence.response.discrete import exponential
from polefence.response.stationary import lyapunov, unstable
from polefence.response.weighting import Stages

POINTS = 256  # looked at for the worst; corners come first
ROADS = 3
# Instants of a period, an even number for Simpson's rule: the plant's fastest pole turns by so much
# from one to the next [rad]. Of the half car's acceleration at 5 ms, one sample late, two steps are
# then within 0.1 % of 64; by the trapezoidal rule they were 2.1 % above.
TURN, MOST_STEPS = 0.25, 16
# Of what an instant adds to the states, in their own sizes: directions that are left out.
LEAST = 1e-9
# Products of doubles in all drives together: 15 s in QEMU; and the longest drive [s].
WORK, LONGEST = 120_000_000, 60.0


@dataclass(frozen=True, eq=False)
class Promise(Short):
    """A proved rms of a signal, and the rows that make it of states and held inputs.

    Attributes
    ----------
    label : str
    level : float
    C, D : (entries, vertices, n) and (entries, vertices, held) arrays
        Held are the newest inputs, then those a sample older, and so on.
    filters : tuple of str
        The weight of each entry, "" without one.
    """

    label: str
    level: float
    C: Array
    D: Array
    filters: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Phase(Short):
    """A part of every period, in which inputs stay as they are.

    Attributes
    ----------
    share : float
        Of the period.
    steps : int
        From its begin to its end.
    late : int
        How many samples old the inputs are that act.
    """

    share: float
    steps: int
    late: int


@dataclass(frozen=True, eq=False)
class Place(Short):
    """One plant of the family, from one instant to the next in each phase of a period.

    Attributes
    ----------
    text : str
        Where it is.
    given : (g,) array
        What the code is given.
    steps : list of (n, n + held + noises) array
    seen : list of (signals, n + held) array
    measured : (r, n + held) array
    """

    text: str
    given: Array
    steps: list[Array]
    seen: list[Array]
    measured: Array


@dataclass(frozen=True, eq=False)
class Board(Short):
    """Loop of a design and its code, to be driven.

    Attributes
    ----------
    places : tuple of Place
    promises : tuple of Promise
    phases : tuple of Phase
    samples : int
        Of a drive.
    between : bool
        Whether signals are looked at between samples too; not of a plant in discrete time.
    proved_of : str
        What times the bounds are about.
    """

    places: tuple[Place, ...]
    promises: tuple[Promise, ...]
    phases: tuple[Phase, ...]
    samples: int
    between: bool
    proved_of: str


def board_sources(
    design: Design, program: Program, texts: Texts, claims: Sequence[Claim]
) -> dict[str, str]:
    """Return the program that drives the law, and what starts it on a processor, by file names.

    Parameters
    ----------
    design : Design
        As it is exported.
    claims : sequence of Claim
        What is proved; the bounds on an rms under the same noise as the first are driven.

    Raises
    ------
    InputError
        If no rms is bounded, or the code has no sample time.
    """
    require_drivable(claims, texts.sample_time is not None)
    given = context(program, texts) | _numbers(_board(design, program, texts, claims), program)
    given |= {"seconds": NUMBERS[64].text(float(texts.sample_time or 0))}
    template = environment().get_template("board.c.j2")
    return {f"{texts.name}_board.c": template.render(given)} | start_sources(texts.name)


def start_sources(name: str) -> dict[str, str]:
    """Return what starts a program on an emulated Cortex-M: its first code, and the memories."""
    endings = {f"{name}_start.{end}": f"board_start.{end}.j2" for end in ("c", "ld")}
    return {
        file: environment().get_template(template).render(marker=MARKER)
        for file, template in endings.items()
    }


def require_drivable(claims: Sequence[Claim], timed: bool, observer: bool = False) -> None:
    """Refuse what no board can drive; timed is code that has a sample time.

    Raises
    ------
    InputError
        If no rms is bounded, the code has no sample time, or there is an observer.
    """
    if not any(claim.kind == "rms" for claim in claims):
        raise InputError(
            "a board (--board) drives signals whose rms is bounded, and the design bounds none; "
            "make it by `polefence optimise`, with a limit on an rms"
        )
    if not timed:
        raise InputError("a board (--board) runs the law at a sample time: give --sample-time")
    if observer:
        raise InputError("a board (--board) holds only the law; leave out the observer")


def _board(design: Design, program: Program, texts: Texts, claims: Sequence[Claim]) -> Board:
    if design.law.passes:
        raise InputError(
            "a board (--board) reads samples, and white noise that passes straight into what the "
            "law measures has no finite variance there; give the sensor a bandwidth"
        )
    own, delay = kept(design), texts.delay
    sampling = design.plant.sampling
    plant = design.plant if sampling is None else sampling.plant
    n, m = plant.shape
    if sampling is None:
        n, m = n - own, m - own
    bounds = [one for one in claims if isinstance(one, Rms) and one.kind == "rms"]  # no decay
    noise = {(claim.intensity, claim.scales) for claim in bounds[:1]}
    made = [
        _promise(claim, _units(design.plant), (n, m, delay), sampling is not None)
        for claim in bounds
        if (claim.intensity, claim.scales) in noise
    ]
    promises = tuple(promise for promise in made if promise is not None)
    if not promises:
        raise InputError(
            "a board (--board) drives bounds on the rms of the plant's own signals, without white "
            "noise in them; the design has none"
        )
    period = float(texts.sample_time or 0)
    alphas = cloud(design, POINTS)[:POINTS]
    E = _noise(plant, bounds[0], alphas)[:, :n]
    worst = _worst(design, promises, alphas, E, period, delay)
    phases = _phases(plant, n, period, delay, 0.0 if sampling is None else float(sampling.early))
    sizes = (n, m, delay)
    places = [
        _place(design, plant, program, promises, alphas[k], E[k], sizes, phases, period)
        for k in worst
    ]
    width = max(M.shape[1] for place in places for M in place.steps)
    places = [_wide(place, width) for place in places]
    rows = places[0].steps[0].size + places[0].seen[0].size
    steps = sum(phase.steps for phase in phases)
    samples = int(WORK / (len(places) * ROADS * steps * rows))
    samples = max(100, min(samples, int(LONGEST / period)))
    between, proved_of = plant.sample_time is None, "in continuous time"
    if design.plant.sample_time is not None:
        proved_of = "at all times" if sampling is not None else "at samples"
        if not all(claim.held for claim in bounds) and sampling is not None:
            proved_of += ", of weighted signals at samples"
    return Board(tuple(places), promises, phases, samples, between, proved_of)


def _units(plant: UncertainPlant) -> dict[str, str]:
    return {signal.name: signal.unit for signal in plant.signals}


def _promise(
    claim: Rms, units: dict[str, str], sizes: tuple[int, int, int], sampled: bool
) -> Promise | None:
    """Return what a claim bounds; None where that is not of the plant alone, or is white noise."""
    n, m, delay = sizes
    rows_C, rows_D = [], []
    for output in claim.outputs:
        C, D = (_floats(M) for M in (output.C, output.D))
        if any(any(any(row) for row in F) for F in output.F):
            return None
        late = delay * m if sampled else 0
        if C[:, n + late :].any() or D[:, m:].any():
            return None
        held = np.zeros((len(C), (delay + 1) * m))
        held[:, :m] = D[:, :m]
        if sampled:  # inputs on their way are states there
            held[:, m : m + late] = C[:, n : n + late]
        elif delay:  # u acts late, and is seen as it acts
            held = np.roll(held, delay * m, axis=1)
        rows_C.append(C[:, :n])
        rows_D.append(held)
    names = tuple("" if f is None else f.name for f in claim.filters or (None,) * len(rows_C))
    every = [output.name for output in claim.outputs]
    weights = [name for name in dict.fromkeys(names) if name]
    unit = units.get(every[0], "")
    label = " and ".join([*every]) + "".join(f", {name}" for name in weights)
    label += f" [{unit}]" if unit else ""
    return Promise(label, float(claim.level), np.array(rows_C), np.array(rows_D), names)


def _floats(matrices: Any) -> Array:
    return np.array([[float(x) for x in rows[0]] for rows in matrices])


def _noise(plant: UncertainPlant, claim: Rms, alphas: Array) -> Array:
    """Return E at points, such that its noise is white of intensity one."""
    scales = np.array([float(s) for s in claim.scales] or [1.0] * plant.disturbance_count)
    return np.asarray(float(claim.intensity) ** 0.5 * plant.driven(alphas) * scales)


def _worst(
    design: Design,
    promises: Sequence[Promise],
    alphas: Array,
    E: Array,
    period: float,
    delay: int,
) -> list[int]:
    """Return the points at which an rms of the sampled loop is largest, each once."""
    plant, own, K = design.plant, kept(design), design.law.gain(alphas)
    n, m = E.shape[1], plant.shape[1] - own
    if plant.sample_time is None:
        moves = stepped(design, alphas, period, delay)
        late = np.arange(plant.shape[0], plant.shape[0] + late_inputs(design, delay))
    else:
        A, B = plant.at(alphas)
        moves, late = A + B @ K, np.arange(n, n + delay * m)
    base = design.plant if plant.sampling is None else plant.sampling.plant
    total = moves.shape[-1]
    added = np.zeros((len(alphas), total, total))
    added[:, :n, :n] = _covariance(base.at(alphas)[0][:, :n, :n], E, period, base)
    slow = (moves - np.eye(total)) / period
    bad = unstable(slow, period)
    if len(bad):
        return [int(bad[0])]
    X = lyapunov(slow, added / period, period)
    newest = np.zeros((len(alphas), m, total))
    newest[..., : K.shape[-1]] = K[:, :m]
    places = list[int]()
    for promise in promises:
        square = np.zeros(len(alphas))
        for C, D in zip(promise.C, promise.D, strict=True):
            row = np.zeros((len(alphas), total))
            row[:, :n] = alphas @ C
            held = alphas @ D
            row[:, late] += held[:, m:]
            row += np.einsum("ak,akj->aj", held[:, :m], newest)
            square += np.einsum("ai,aij,aj->a", row, X, row)
        places.append(int(np.argmax(square)))
    return list(dict.fromkeys(places))


def _phases(
    plant: UncertainPlant, n: int, period: float, delay: int, early: float
) -> tuple[Phase, ...]:
    """Return the phases of a period; in the last one inputs act that are a sample younger."""
    if plant.sample_time is not None:
        return (Phase(1.0, 1, delay),)
    fastest = float(np.abs(np.linalg.eigvals(plant.A[:, :n, :n])).max())
    shares = [(1 - early, delay), (early, delay - 1)] if early else [(1.0, delay)]
    turns = (np.ceil(share * period * fastest / TURN / 2) for share, _ in shares)
    steps = (2 * int(np.clip(turn, 1, MOST_STEPS // 2)) for turn in turns)
    return tuple(Phase(share, k, late) for (share, late), k in zip(shares, steps, strict=True))


def _covariance(A: Array, E: Array, time: float, plant: UncertainPlant) -> Array:
    """Return what white noise adds to the states in a time, (count, n, n): Van Loan 1978."""
    square = E @ np.swapaxes(E, -1, -2)
    if plant.sample_time is not None:  # held from one sample to the next
        return np.asarray(square / time)
    n = A.shape[-1]
    block = np.zeros((*A.shape[:-2], 2 * n, 2 * n))
    block[..., :n, :n], block[..., :n, n:] = -A, square
    block[..., n:, n:] = np.swapaxes(A, -1, -2)
    whole = exponential(block * time)
    Q = np.swapaxes(whole[..., n:, n:], -1, -2) @ whole[..., :n, n:]
    return np.asarray((Q + np.swapaxes(Q, -1, -2)) / 2)


def _place(
    design: Design,
    plant: UncertainPlant,
    program: Program,
    promises: Sequence[Promise],
    alpha: Array,
    E: Array,
    sizes: tuple[int, int, int],
    phases: tuple[Phase, ...],
    period: float,
) -> Place:
    """Return the plant at one point, with the filters behind its signals."""
    n, m, delay = sizes
    width = (delay + 1) * m
    steps, seen = list[Array](), list[Array]()
    for phase in phases:
        A, driven, acting, rows = _behind_filters(plant, promises, alpha, E, sizes, phase.late)
        total, time = len(A), phase.share * period / phase.steps
        Q = _covariance(A, driven, time, plant)
        if plant.sample_time is None:
            block = np.zeros((total + width, total + width))
            block[:total] = np.hstack([A, acting]) * time
            moved = exponential(block)[:total]
        else:
            moved = np.hstack([A, acting])
        steps.append(np.hstack([moved, _root(Q)]))
        seen.append(rows)
    own = kept(design)
    late = [] if design.plant.sampling is None else list(range(total, total + delay * m))
    measured = _measured(design, alpha, own, (n, total, width), late)
    values = _given(design, program, alpha)
    text = where_text(design.plant, alpha.tolist()).removeprefix(" at ") or "the plant"
    return Place(text, values, steps, seen, measured)


def _behind_filters(
    plant: UncertainPlant,
    promises: Sequence[Promise],
    alpha: Array,
    E: Array,
    sizes: tuple[int, int, int],
    late: int,
) -> tuple[Array, Array, Array, Array]:
    """Return A, E and B of plant and filters where inputs so late act, and the rows of signals.

    Signals that show the inputs that are first to act, ``delay`` samples late, show these.
    """
    n, m, delay = sizes
    A, B = (M[:n, :c] for M, c in zip(plant.at(alpha), (n, m), strict=True))
    first, now = (slice(k * m, (k + 1) * m) for k in (delay, late))
    acting = np.zeros((n, (delay + 1) * m))
    acting[:, now] = B
    rows = list[tuple[Array, Array]]()
    for promise in promises:
        for C, D, weight in zip(promise.C, promise.D, promise.filters, strict=True):
            c, d = alpha @ C, alpha @ D
            shown, d[first] = d[first].copy(), 0
            d[now] += shown
            c = np.concatenate([c, np.zeros(len(A) - len(c))])
            known = named(weight)
            if known is not None:
                A, E, acting, c, d = _filtered(A, E, acting, c, d, known)
            rows.append((c, d))
    total = len(A)
    seen = np.array([np.concatenate([c, np.zeros(total - len(c)), d]) for c, d in rows])
    return A, E, acting, seen


def _filtered(
    A: Array, E: Array, acting: Array, c: Array, d: Array, weight: Stages
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the plant with a filter behind y = c x + d v, and the row of what comes out."""
    known = filter_of(weight, Fraction(0))
    a, b, out = (
        np.array([[float(x) for x in row] for row in M]) for M in (known.a, known.b, known.c)
    )
    n, k = len(A), len(a)
    larger = np.block([[A, np.zeros((n, k))], [b * c, a]])
    E = np.vstack([E, np.zeros((k, E.shape[1]))])
    return larger, E, np.vstack([acting, b * d]), np.concatenate([np.zeros(n), out[0]]), 0 * d


def _measured(
    design: Design, alpha: Array, own: int, sizes: tuple[int, int, int], late: list[int]
) -> Array:
    """Return the rows of what the code measures, of states and held inputs."""
    n, total, width = sizes
    signals, law = design.plant.shape[0] - own, design.law
    if law.measured:
        arrays = [y.arrays(design.plant)[0] for y in law.measured]
        C = np.array([alpha @ rows for rows in arrays])[: len(arrays) - own]
    else:
        C = np.eye(signals, design.plant.shape[0])
    rows = np.zeros((len(C), total + width))
    rows[:, :n], rows[:, late] = C[:, :n], C[:, n : n + len(late)]
    return rows


def _given(design: Design, program: Program, alpha: Array) -> Array:
    """Return what the code is given at a point, as numbers of its format; words as integers."""
    if isinstance(program, Fixed):
        return np.zeros(0)
    if not program.shares:
        whole = 2.0 ** (program.number.bits - 2)
        return program.number.nearest(alpha) if program.scales is None else np.round(alpha * whole)
    values = values_at(design.plant, alpha.tolist())
    scales = program.scales
    if values is None:
        raise InputError("a point of the family has no parameters; export with --given alpha")
    given = np.array(list(values.values()))
    if scales is None:
        return program.number.nearest(given)
    ends = np.array([(share.low, share.high) for share in program.shares]).T
    units = 2.0 ** np.array(scales.given)
    return np.asarray(np.round(np.clip(given, *ends) * units))


def _root(Q: Array) -> Array:
    """Return N with N N' = Q, a column for each direction that is not small."""
    size = np.sqrt(np.maximum(np.diagonal(Q), 0.0))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(Q / np.outer(size, size))
    large = values > LEAST * max(float(values.max()), 0.0)
    return np.asarray(size[:, None] * vectors[:, large] * np.sqrt(values[large]))


def _wide(place: Place, width: int) -> Place:
    """Return a place with as many columns of noise as the others."""
    steps = [np.pad(M, ((0, 0), (0, width - M.shape[1]))) for M in place.steps]
    return replace(place, steps=steps)


def _numbers(board: Board, program: Program) -> dict[str, Any]:
    """Return the context of the template."""
    double, first = NUMBERS[64], board.places[0]
    total, (_, width) = len(first.steps[0]), first.seen[0].shape

    def given(value: float) -> str:
        return program.number.text(value) if program.scales is None else f"{value:.0f}"

    def table(matrix: Array) -> list[str]:
        return [", ".join(double.text(float(x)) for x in row) for row in matrix]

    places = [
        {
            "text": _quoted(place.text),
            "given": [given(float(x)) for x in place.given],
            "steps": [table(M) for M in place.steps],
            "seen": [table(M) for M in place.seen],
            "measured": table(place.measured),
        }
        for place in board.places
    ]
    promises = [
        {
            "label": _quoted(promise.label),
            "level": double.text(promise.level),
            "entries": len(promise.C),
        }
        for promise in board.promises
    ]
    return {
        "places": places,
        "promises": promises,
        "plant_states": total,
        "held": width - total,
        "noises": first.steps[0].shape[1] - width,
        "signals_seen": len(first.seen[0]),
        "phases": [(phase.steps, double.text(phase.share)) for phase in board.phases],
        "samples": board.samples,
        "roads": ROADS,
        "between": board.between,
        "proved_of": board.proved_of,
        "driven_how": "between samples too, white noise" if board.between else "at samples",
        "widest": max(len(str(promise["label"])) for promise in promises),
    }


def _quoted(text: str) -> str:
    """Return text that can stand in a string of C."""
    return comment(text).replace('"', "'")
