"""Errors in loops that make a plant unstable: the other side of a margin, decided exactly.

Where an error of gain c has the phase that the loop lacks, a pole is on the imaginary axis; beyond
c it is to the right. A number or an all-pass of first order has any phase at one frequency. Of
several loops the phases are sought at which the spectral radius of M delta is largest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any, cast

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import InputError
from polefence.certify.counterexample import FEW, shown
from polefence.certify.robust.family import short
from polefence.law.laws import Law
from polefence.plant.delta import delta_form
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.failure import Error, Failure
from polefence.proof.document import Document
from polefence.proof.matrices import ONE
from polefence.proof.polynomials import coordinates
from polefence.proof.regions import Ellipse, Part, parts_of
from polefence.proof.work import FormatError, counted
from polefence.region.regions import Disk, HalfPlane
from polefence.requirements.disk_margin import DiskMargin
from polefence.requirements.gain import Gain
from polefence.requirements.slopes import Loops
from polefence.requirements.weights import behind
from polefence.response.closed import close
from polefence.response.modes import Modes
from polefence.response.peaks import peaks, response

BEYOND = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # of the gain at which a pole is on the axis
FINE = 2**30  # parts of a number that are told apart
REAL = 1e-3  # a phase that is nearer to none is that of a number: at most 1e-6 of a gain off
STARTS, SPREAD = 4, 0.3  # from which phases are sought besides, and how far from the first
SEED = 1


def broken(
    plant: UncertainPlant,
    law: Law,
    margin: DiskMargin,
    alpha: Sequence[Fraction],
    within: Fraction | None = None,
) -> Failure | None:
    """Return nearly the least errors with which the loops are unstable at alpha, exactly.

    None where none were found, or the plant is not known exactly.

    Parameters
    ----------
    within : Fraction, optional
        Of which gain they are to be less.
    """
    if not known_exactly(plant):
        return None
    with suppress(InputError, FormatError, np.linalg.LinAlgError):
        blank = _blank(plant, law, margin, alpha)
        loops = _opened(plant, law, margin, np.array([[float(a) for a in alpha]]))
        for w, delta in _destabilising(loops):
            for gain in _gains(float(np.abs(delta).max()), within):
                errors = (_error(complex(d), w, float(loops.modes.step), gain) for d in delta)
                failure = decided(replace(blank, errors=tuple(errors)))
                if failure is not None:
                    return failure
    return None


def _gains(least: float, within: Fraction | None) -> Iterator[Fraction]:
    """Yield gains from the least on, in few digits; else one between it and a limit."""
    for beyond in BEYOND:
        gain = short(least * (1 + beyond), up=True)
        if within is None or gain < within:
            yield gain
        elif least < within:
            yield (Fraction(least) + within) / 2
            return


def known_exactly(plant: UncertainPlant) -> bool:
    """Whether errors in the loops of a plant are decided exactly."""
    return plant.remainder is None and plant.dead_time is None


def document_of(claims: Sequence[Failure]) -> Document:
    """Return a file of claims about one plant."""
    first = claims[0]
    return Document(first.plant, first.law, tuple(claims), first.on, polefence=VERSION)


def failure_at(
    plant: UncertainPlant, law: Law, region: tuple[Part, ...], alpha: Sequence[Fraction]
) -> Failure:
    """Return the claim that a pole is not in a region at alpha."""
    on, sizes = law.domain_of(plant).on, plant.domain.sizes
    at = tuple(coordinates(list(alpha), sizes))
    at = at[1::2] if plant.parameters else at
    return Failure(file_plant(plant), law.exact, on, region, at)


def decided(failure: Failure) -> Failure | None:
    """Return a claim with what proves it; None where nothing does."""
    curved = any(isinstance(part, Ellipse) for part in failure.region)
    few = failure.size <= FEW and not curved
    with suppress(FormatError):
        if few and prove(failure).proved:
            return failure
        with counted():
            failure.require()
            N, W, off = failure.loop()
            by = shown((N, W), failure.region, off)
        if by is not None:
            failure = replace(failure, outside=by)
        if (by is not None or not few) and prove(failure).proved:
            return failure
    return None


def _blank(
    plant: UncertainPlant, law: Law, margin: DiskMargin, alpha: Sequence[Fraction]
) -> Failure:
    """Return the claim without its errors."""
    region = HalfPlane(0) if plant.sample_time is None else Disk(0, 1)
    loops = margin.loops_of(plant, law.exact)
    loops = replace(loops, weights=(ONE,) * loops.count)
    shapes = tuple(shape.filter for shape in margin.shapes_at(plant))
    claim = failure_at(plant, law, parts_of(region.document()), alpha)
    return replace(claim, loops=loops, filters=shapes)


def _opened(plant: UncertainPlant, law: Any, margin: DiskMargin, alpha: Array) -> Loops:
    """Return the opened loops at points alpha, weighed as their bound is."""
    opened, beside, gain = margin.posed(plant, law)
    wide = behind(opened, beside, gain)
    closed = close(wide.plant, wide.law, alpha)
    channel = Gain.channel(cast("Gain", wide.specification), delta_form(wide.plant), alpha)
    return channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)


def _destabilising(loops: Loops) -> Iterator[tuple[float, Array]]:
    """Yield frequencies [rad/s] and errors there that put a pole on the axis, the least first.

    Frequencies are those of the bilinear transform where the loops are in delta form.
    """
    _, frequencies, heights = peaks(loops.modes, loops.E, loops.C, loops.F)
    found = list[tuple[float, Array]]()
    for k in np.argsort(-heights):
        w = float(frequencies[k])
        if not np.isfinite(w) or not np.isfinite(heights[k]) or not heights[k]:
            continue
        found.append(_alone(loops, w) if loops.E.shape[-1] == 1 else _together(loops, w))
    yield from sorted(found, key=lambda pair: float(np.abs(pair[1]).max()))


def _response(loops: Loops, w: float) -> Array:
    s = np.array([[1j * w / (1 - 0.5j * w * loops.modes.step)]])
    return np.asarray(response(loops.A, loops.E, loops.C, loops.F, s)[0, 0])


def _alone(loops: Loops, w: float) -> tuple[float, Array]:
    return w, 1 / _response(loops, w)[0]


def _together(loops: Loops, w: float) -> tuple[float, Array]:
    """Return errors of one gain in every loop: phases near those of the singular vectors."""
    from scipy.optimize import minimize  # deferred: slow to import

    def radius(z: Array) -> complex:
        G = _response(loops, float(w * np.exp(z[0]))) * np.exp(1j * np.append(0.0, z[1:]))
        values = np.linalg.eigvals(G)
        return complex(values[np.abs(values).argmax()])

    def level(z: Array) -> float:
        return -abs(radius(z))

    def climbed(z: Array) -> Array:
        options = {"maxiter": 200 * len(z), "xatol": 1e-10, "fatol": -1e-14 * level(z)}
        settings: dict[str, Any] = {"method": "Nelder-Mead", "options": options}
        return np.asarray(minimize(level, z, **settings).x)

    u, _, vh = np.linalg.svd(_response(loops, w))
    phases = np.angle(vh[0].conj()) - np.angle(u[:, 0])
    first = np.append(0.0, phases[1:] - phases[0])  # the frequency, and phases beside that of one
    random = np.random.default_rng(SEED)
    starts = [first + SPREAD * random.standard_normal(len(first)) for _ in range(STARTS)]
    best = min(map(climbed, [first, *starts]), key=level)
    delta = np.exp(1j * np.append(0.0, best[1:])) / radius(best)
    return float(w * np.exp(best[0])), np.asarray(delta)


def _error(delta: complex, w: float, step: float, gain: Fraction) -> Error:
    """Return the error of a gain with the phase of delta at a frequency [rad/s]."""
    phase = float(np.angle(delta))
    if min(abs(phase), np.pi - abs(phase)) < REAL or not w:
        return Error(gain if abs(phase) < np.pi / 2 else -gain)
    if not step:  # that of (s - a)/(s + a) is from 0 to pi
        sign, phase = (1, phase) if phase > 0 else (-1, phase + np.pi)
        return Error(sign * gain, _near(w / np.tan((np.pi - phase) / 2)))
    sign, phase = (1, phase) if phase < 0 else (-1, phase - np.pi)
    angle = 2 * np.arctan(w * step / 2)  # that of (1 - a z)/(z - a) is from -pi to 0
    return Error(sign * gain, _near(np.sin((phase + angle) / 2) / np.sin((phase - angle) / 2)))


def _near(x: float) -> Fraction:
    """Return a short rational near a number."""
    size = Fraction(2) ** int(np.frexp(x)[1])
    return Fraction(round(Fraction(float(x)) / size * FINE), FINE) * size
