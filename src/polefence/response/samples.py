"""A plant as a computer sees it: its samples, with inputs held between them, and late.

At a vertex they are those of the matrix exponential. Between vertices the exponential is no
combination of these: what it is off by, a second-order effect of how far the vertices are apart
within a sample, is the plant's remainder, whose bound is evaluated in exact arithmetic and proved
with every design.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, require_type
from polefence.plant.family import Sampling, UncertainPlant
from polefence.plant.outputs import Output, inputs, states
from polefence.plant.parameters import exact
from polefence.plant.samples import claim_of_samples
from polefence.plant.system import Array, System
from polefence.proof.claims.base import prove
from polefence.proof.claims.samples import MAX_DELAY, MAX_TERMS
from polefence.proof.remainder import Remainder
from polefence.proof.work import FormatError
from polefence.response.discrete import balancing, zero_order_hold

ROOM = 1.01  # of the remainder over what it has to hold
SMALL, TINY = 1e-7, 1e-12  # terms left out, over the entries; an entry as good as none
STAYS = 0.9  # of what was left out, with one term less
BITS = 24  # of its numbers


def at_sample_time(plant: UncertainPlant, sample_time: Any, delay: int = 0) -> UncertainPlant:
    """Return a plant's samples as a plant in discrete time, for designs at the sample time.

    Inputs and disturbances are held between samples.

    Parameters
    ----------
    plant : UncertainPlant
        In continuous time.
    sample_time : number
        T [s].
    delay : int
        How many samples late an input acts: 1 where the law is computed during a step. The inputs
        on their way are further states, so that a law may feed them back.

    Returns
    -------
    UncertainPlant
        Its vertices are the samples of the plant's, to rounding; its ``remainder`` bounds what
        the samples of any other plant of the family are off by, and every proof about it holds for
        all of those.

    Raises
    ------
    InputError
        If the plant is in discrete time, the sample time is not positive, or so long that the
        series of the exponential has too many terms.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    T = _time(plant, sample_time)
    if not isinstance(delay, int) or isinstance(delay, bool) or not 0 <= delay <= MAX_DELAY:
        raise InputError(f"delay = {delay!r} must be 0 to {MAX_DELAY}, in samples")
    found = _on_the_way(plant, _held(plant, T), T, delay)
    units = _units(plant)
    entries, rest, terms = _entries(plant, found, units, delay)
    n, m = plant.shape
    each = (entries + rest) * ROOM
    each *= units[:n, None] / units
    whole = np.zeros((n + delay * m, sum(found.shape) + plant.disturbance_count))
    acting = slice(n + delay * m - m, n + delay * m) if delay else slice(n, n + m)
    whole[:n, :n], whole[:n, acting] = each[:, :n], each[:, n : n + m]
    whole[:n, sum(found.shape) :] = each[:, n + m :]
    remainder = Remainder(tuple(map(_up, whole)))
    own = Sampling(plant, delay, terms, tuple(map(Fraction, units.tolist())))
    found = replace(found, remainder=remainder, sampling=own)
    verdict = prove(claim_of_samples(found))
    if not verdict.proved:
        raise InputError(f"{plant.name} sampled every {float(T):g} s: {verdict.reason}")
    return found


def _time(plant: UncertainPlant, sample_time: Any) -> Fraction:
    if plant.sample_time is not None:
        raise InputError(
            f"{plant.name} is in discrete time already, every {float(plant.sample_time):g} s"
        )
    try:
        T = exact(sample_time, "sample_time")
    except (TypeError, ValueError) as error:
        raise InputError(f"sample_time = {sample_time!r} must be a number of seconds") from error
    if T <= 0:
        raise InputError(f"sample_time = {float(T):g} must be positive, in seconds")
    if isinstance(sample_time, float):  # 0.02 s, not the double next to it
        T = Fraction(repr(sample_time))
    return T


def _held(plant: UncertainPlant, T: Fraction) -> list[tuple[Array, Array, Array]]:
    """Return F, G, H of every vertex."""
    m, found = plant.shape[1], []
    for vertex in plant.vertices:
        E = np.zeros((plant.shape[0], 0)) if vertex.E is None else vertex.E
        F, GH = zero_order_hold(vertex.A, np.hstack([vertex.B, E]), float(T))
        if not (np.all(np.isfinite(F)) and np.all(np.isfinite(GH))):
            raise InputError(
                f"{plant.name} outgrows floating point in a sample of {float(T):g} s; take a "
                "shorter one"
            )
        found.append((F, GH[:, :m], GH[:, m:]))
    return found


def _on_the_way(
    plant: UncertainPlant, held: list[tuple[Array, Array, Array]], T: Fraction, delay: int
) -> UncertainPlant:
    """Return the plant in discrete time, with the inputs on their way as states."""
    n, m = plant.shape
    late = delay * m
    vertices = []
    for k, (F, G, H) in enumerate(held):
        A, B = np.zeros((n + late, n + late)), np.zeros((n + late, m))
        A[:n, :n] = F
        if delay:
            A[:n, n + late - m :] = G
            A[n + m :, n : n + late - m] = np.eye(late - m)
            B[n : n + m] = np.eye(m)
        else:
            B[:n] = G
        E = np.vstack([H, np.zeros((late, H.shape[1]))]) if H.shape[1] else None
        vertices.append(System(A, B, E, f"vertex {k + 1}"))  # type: ignore[arg-type]
    labels = [own.label for own in states(plant)]
    for j in range(1, delay + 1):
        ending = f", {j} sample{'s' * (j > 1)} late"
        labels += [_label(own.name + ending, own.unit) for own in inputs(plant)]
    return replace(
        plant,
        vertices=tuple(vertices),
        states=tuple(labels) if plant.states or delay else (),
        outputs=tuple(_late(plant, own, delay) for own in plant.every_output),
        sample_time=T,
        vehicle=None,
    )


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _late(plant: UncertainPlant, output: Output, delay: int) -> Output:
    """Return an output whose part of the inputs is that of those that act."""
    C, D, F = output.exact(plant)
    m = plant.shape[1]
    zeros = (Fraction(0),) * m
    if not delay:
        return replace(output, C=C, D=D, F=F)
    each = zip(C, D, strict=True)
    rows = [(*c, *zeros * (delay - 1), *d) for c, d in each]
    return replace(output, C=rows, D=[zeros for _ in rows], F=F)


def _units(plant: UncertainPlant) -> Array:
    """Return units of states, inputs and disturbances, powers of two, in which they move evenly."""
    n = plant.shape[0]
    E = [np.zeros((n, 0)) if v.E is None else v.E for v in plant.vertices]
    A, B, H = np.abs(plant.A).max(axis=0), np.abs(plant.B).max(axis=0), np.abs(E).max(axis=0)
    d = balancing(A[None])
    speed = float(np.abs(np.linalg.eigvals(plant.A)).max()) or 1.0
    pushes = np.concatenate([B, H], axis=1) / d[:, None]
    size = np.linalg.norm(pushes, axis=0)
    acting = np.where(size > 0, speed / np.where(size > 0, size, 1.0), 1.0)
    return np.concatenate([d, 2.0 ** np.round(np.log2(acting))])


def _entries(
    plant: UncertainPlant, found: UncertainPlant, units: Array, delay: int
) -> tuple[Array, float, int]:
    """Return bounds on what entries are off by, in the units, on the rest, and the terms taken."""
    n, m = found.shape
    # any remainder will do, to see what is off
    wide = Remainder(((Fraction(1),) * (n + m + plant.disturbance_count),) * n)
    where = f"{plant.name} sampled every {float(found.sample_time or 0):g} s"
    last = math.inf
    for terms in range(_terms(plant, units, float(found.sample_time or 0)), MAX_TERMS + 1):
        own = Sampling(plant, delay, terms, tuple(map(Fraction, units.tolist())))
        claim = claim_of_samples(replace(found, remainder=wide, sampling=own))
        try:
            entries, rest = claim.off()
        except FormatError as problem:
            raise InputError(f"{where}: {problem}; take a shorter sample time") from problem
        sizes = np.array([[float(x) for x in row] for row in entries])
        # or what is left is rounding
        if rest <= SMALL * float(sizes.max()) or rest > STAYS * last:
            return sizes, float(rest), terms
        last = float(rest)
    raise InputError(f"{where}: the exponential's series is too long; take a shorter sample time")


def _terms(plant: UncertainPlant, units: Array, T: float) -> int:
    """Return about how many terms leave little out, as the middle of the family tells sizes."""
    n, N = plant.shape[0], len(plant.vertices)
    every = units / units[:n, None]
    E = [np.zeros((n, 0)) if v.E is None else v.E for v in plant.vertices]
    M = T * np.concatenate([plant.A, plant.B, np.array(E)], axis=2) * every
    size = float(np.linalg.norm(M, axis=(1, 2)).max())
    each = np.concatenate([M, M.mean(axis=0)[None]])
    F, G = zero_order_hold(each[:, :, :n], each[:, :, n:], 1.0)
    both = np.concatenate([F, G], axis=2)
    off = max(float(np.abs(both[N] - both[:N].mean(axis=0)).max()), TINY)
    terms, tail = 2, np.inf
    while terms < MAX_TERMS and not tail <= SMALL * off:
        terms += 1
        if 2 * size < terms + 2:
            power = (terms + 1) * math.log(size) - math.lgamma(terms + 2) if size else -math.inf
            tail = math.exp(power) / (1 - size / (terms + 2))
    return terms


def _up(values: Array) -> tuple[Fraction, ...]:
    """Round up to numbers of few digits."""
    found = []
    for value in values.tolist():
        unit = Fraction(2) ** (math.frexp(value)[1] - BITS)
        found.append(math.ceil(Fraction(value) / unit) * unit if value else Fraction(0))
    return tuple(found)
