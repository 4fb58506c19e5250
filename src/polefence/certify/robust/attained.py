"""What a signal is at one plant of a family, from below and in exact arithmetic.

A gain is at least its transfer function at one rational frequency; an rms is computed exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from operator import mul

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.by_transfer import ByTransfer
from polefence.certify.robust.family import Family
from polefence.law.laws import FixedGain, Law
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import labels_of
from polefence.plant.outputs import Output, disturbances, states
from polefence.plant.system import Array, Exact
from polefence.proof.laws import add
from polefence.proof.matrices import Rationals, mix, right_divide
from polefence.proof.polynomials import basis, coordinates
from polefence.proof.transfer import Transfer, imaginary_value
from polefence.proof.work import FormatError
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms
from polefence.requirements.specification import Specification
from polefence.response.modes import Modes
from polefence.response.peaks import peaks, response

FINE = 2**40  # parts of a frequency, and of a direction, that are told apart


def attained(
    plant: UncertainPlant, law: Law, limit: Specification, alpha: Sequence[Fraction]
) -> Fraction | None:
    """Return the square of what a signal is at least at alpha, exactly.

    None of a kind, or of a plant, of which that is not computed exactly.
    """
    if type(limit) not in (Gain, Rms) or law.passes:
        return None
    with suppress(InputError, FormatError, np.linalg.LinAlgError):
        there = _at(plant, law, limit, list(alpha))
        if there is None:
            return None
        loop, asked = there
        known = ByTransfer.of(loop, FixedGain(np.zeros((1, loop.shape[0]))), asked)
        if known is None:
            return None
        if type(asked) is Rms:
            return known.claim.value(known.transfer)
        return _peak(loop, asked, known.transfer) if isinstance(asked, Gain) else None
    return None


def root_down(square: Fraction) -> float:
    """Return a double that is no more than the root."""
    root = math.sqrt(square)
    while Fraction(root) ** 2 > square:
        root = math.nextafter(root, 0)
    return root


def _at(
    plant: UncertainPlant, law: Law, limit: Specification, alpha: list[Fraction]
) -> tuple[UncertainPlant, Specification] | None:
    """Return the closed loop at alpha as a plant in delta form, and what is asked of it."""
    if plant.disturbance_count == 0 or (plant.remainder is not None and plant.functions is None):
        return None
    plant, (n, m) = delta_form(plant), plant.shape
    sizes = law.domain_of(plant).sizes
    at = coordinates(alpha, sizes)
    A, B, E = (
        mix(alpha, [list(map(list, M)) for v in plant.vertices if (M := getattr(v, key))])
        for key in ("exact_A", "exact_B", "exact_E")
    )
    source = plant.remainder and plant.remainder.source
    if source:
        more, off = source.at(tuple(at[1::2]))
        if off:
            return None
        A, B, E = (
            add(M, [row[a:b] for row in more])
            for M, (a, b) in zip(
                (A, B, E), ((0, n), (n, n + m), (n + m, len(more[0]))), strict=True
            )
        )
    exact = law.exact
    if exact.K is not None:
        K: Rationals | None = exact.gain(alpha, at)
    else:
        values = basis(at, sizes, exact.degree)
        K = right_divide(mix(values, exact.Z or []), mix(values, exact.W or []))
    outputs = limit.signals(plant)
    if K is None or any(y.near is not None for y in outputs):
        return None
    closed = add(A, _product(B, K))
    signals = list[Output]()
    for y in outputs:
        C, D, F = (mix(alpha, [[list(row)] for row in rows]) for rows in y.exact(plant))
        signals.append(Output(y.name, y.unit, add(C, _product(D, K)), F=F if any(F[0]) else ()))
    idle = tuple((Fraction(1),) for _ in range(n))  # an input that the gain of zero leaves alone
    loop = replace(
        UncertainPlant.from_vertices([_exact(closed)], [idle], [_exact(E)], name=plant.name),
        states=labels_of(states(plant)),
        disturbances=labels_of(disturbances(plant)),
        noise=plant.noise,
        step=plant.step,
    )
    return loop, replace(limit, signal=tuple(signals), at_most=None)


def _peak(loop: UncertainPlant, limit: Gain, transfer: Transfer) -> Fraction | None:
    """Return the square of the gain near the worst frequency, in nearly the worst direction."""
    channel = limit.channel(loop, np.ones((1, 1)))
    step = float(loop.step)
    modes = Modes(channel.A, step)
    band = limit.ends(step)
    _, frequencies, heights = peaks(modes, channel.E, channel.C, channel.F, band)
    if not len(heights):
        return None
    w = float(frequencies[int(heights.argmax())])
    if not np.isfinite(w):
        return None
    s = np.array([[1j * w / (1 - 0.5j * w * step)]])
    G = response(channel.A, channel.E, channel.C, channel.F, s)[0, 0]
    v = np.linalg.svd(G)[2][0].conj()
    near = _within(_near(w), limit, loop.step)
    if near is None:
        return None
    x = near * transfer.unit
    a, b = transfer.first
    bottom = _square(*imaginary_value(a, x))
    if not bottom:
        return None
    direction = [(_near(float(z.real)), _near(float(z.imag))) for z in v]
    total = Fraction(0)
    for row in b:
        parts = [
            _times(imaginary_value(entry, x), z) for entry, z in zip(row, direction, strict=True)
        ]
        total += _square(sum(re for re, _ in parts), sum(im for _, im in parts))
    size = sum(_square(*z) for z in direction)
    return transfer.scale**2 * total / (bottom * size)


def _near(x: float) -> Fraction:
    """Return a short rational near a number."""
    if not x:
        return Fraction(0)
    size = Fraction(2) ** math.frexp(x)[1]
    return Fraction(round(Fraction(x) / size * FINE), FINE) * size


def _within(w: Fraction, limit: Gain, step: Fraction) -> Fraction | None:
    """Return a frequency, or the end of the limit's band that it is beyond; None of no band."""
    if limit.exact_band is None:
        return w
    ends = limit.exact_band.inside(step)
    if ends is None:
        return None
    return max(ends[0], w if ends[1] is None else min(w, ends[1]))


def _times(a: tuple[Fraction, Fraction], b: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _square(re: Fraction | int, im: Fraction | int) -> Fraction:
    return Fraction(re * re + im * im)


def _product(left: Rationals, right: Rationals) -> Rationals:
    columns = list(zip(*right, strict=True))
    return [[sum(map(mul, row, column), Fraction(0)) for column in columns] for row in left]


def _exact(M: Rationals) -> Exact:
    return tuple(map(tuple, M))


def climbed(
    family: Family, limit: Specification, alpha: Array, worst: float
) -> tuple[Array, float]:
    """Return a point near alpha where a signal is no less, and what it is there, in floats."""
    random, step = np.random.default_rng(0), 0.3
    domain = family.law.domain_of(family.plant)
    uppers = domain.coordinates(alpha)[1::2]
    while step > 1e-3:
        moved = np.clip(uppers + step * random.normal(size=(16, len(uppers))), 0, 1)
        trials = domain.alpha(np.stack([1 - moved, moved], axis=-1).reshape(16, -1))
        try:
            values = family.values(limit, trials)
        except (InputError, np.linalg.LinAlgError):
            break
        k = int(values.argmax())
        if values[k] > worst * (1 + 1e-9):
            uppers, alpha, worst = moved[k], trials[k], float(values[k])
        else:
            step *= 0.5
    return alpha, worst
