"""Delay margins: how late an input may be, by a constant time, before the loop is unstable."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array, System
from polefence.proof import claims as proof
from polefence.proof.claims.delay_margin import late_by
from polefence.proof.covers import COVERS, samples
from polefence.proof.filters import Filter
from polefence.proof.text import exactly
from polefence.requirements.disk_margin import (
    DiskMargin,
    LoopGain,
    Posed,
    opened_subject,
    place_of,
)
from polefence.requirements.gain import Highest
from polefence.requirements.slopes import Channel, Slopes, Turned
from polefence.requirements.slopes import Loops as ClosedLoops
from polefence.requirements.specification import Specification
from polefence.requirements.weights import Shape
from polefence.response.peaks import climbed

SAMPLES = 200  # beside the vertices, near which a margin is looked for
WORST = 24  # of them, at which that of each cover is
HALVINGS = 16  # of what a cover takes of the margin that samples show
LARGEST = 8.0  # times the level of samples: none above is looked for
LEAST = 1e-6  # of a level: no margin above 1e6 s is looked for
BELOW = 2.001e-5  # of a level of whole samples, just above which a proof is looked for


@dataclass(frozen=True)
class LateShape(Shape):
    """What is left of a delay beside its centre, of a level and a cover."""

    level: Fraction
    cover: int

    def __hash__(self) -> int:
        return hash((self.level, self.cover))

    def at(self, T: Fraction) -> Filter:
        """Return the filter at a sample time, in its delta form; zero in continuous time."""
        return late_by(self.level, T, self.cover).filter(self.level)


def _shape(level: Fraction, cover: int) -> LateShape:
    return LateShape(late_by(level, Fraction(0), cover).filter(level), level, cover)


def _levels(w: Array, size: Array) -> Array:
    """Return 1 over the delay at which a T of this size at w is too large for the first cover.

    |M / D|^2 = (m0 + m1 y + m2 y^2) / (d0 + d1 y + d2 y^2) of y = (w t)^2 rises with it: to be no
    less than size^2 it has one root. A size below about a half is never too large.
    """
    return w * np.sqrt(_inverse_squares(size)[0])


def _rises(w: Array, size: Array) -> Array:
    """Return the slopes of `_levels` with respect to the size."""
    x, rise = _inverse_squares(size)
    return np.where(x > 0, w * rise / (2 * np.sqrt(np.maximum(x, 1e-300))), 0.0)


def _inverse_squares(size: Array) -> tuple[Array, Array]:
    """Return 1 / y for which |M / D| is 1 over a size, and its slope."""
    m, d = (
        (float(P[0]) ** 2, float(P[1]) ** 2 - 2 * float(P[0] * P[2]), float(P[2]) ** 2)
        for P in (COVERS[0].M, COVERS[0].D)
    )
    size = np.minimum(size, 0.999 * math.sqrt(d[0] / m[0]))
    some = size > math.sqrt(d[2] / m[2]) * (1 + 1e-9)
    q = 1 / np.where(some, size, 1.0) ** 2
    c, b, a = (m[k] - q * d[k] for k in range(3))  # c x^2 + b x + a = 0 with x = 1 / y, c < 0 < a
    root = np.sqrt(b * b - 4 * a * c)
    x = np.where(b > 0, (b + root) / (-2 * c), 2 * a / (root - b))
    rise = -(d[0] * x * x + d[1] * x + d[2]) / (2 * c * x + b) * 2 * q / np.where(some, size, 1.0)
    return np.where(some, x, 0.0), np.where(some, rise, 0.0)


def _of_samples(count: int, T: float) -> float:
    return (1 - BELOW) / (count * T)


@dataclass(frozen=True)
class LateGain(LoopGain):
    """The gain at an input that is late, with the centre of a cover in the loop."""

    cover: int = 0

    def arriving(self, plant: UncertainPlant, n: int) -> UncertainPlant:
        """Return the plant with what acts in the place of the input."""
        if self.at_most is None:
            return plant
        late = late_by(Fraction(self.at_most), plant.period, self.cover)
        if not late.acts and late.straight == 1:
            return plant
        size, i = plant.shape[0], self.loops.inputs[0]
        vertices = list[System]()
        for v in plant.vertices:
            rows = [(*a, *b) for a, b in zip(v.exact_A, v.exact_B, strict=True)]
            rows = [late.put(row, n, size + i) if k < n else row for k, row in enumerate(rows)]
            A, B = (tuple(row[part] for row in rows) for part in (slice(size), slice(size, None)))
            vertices.append(System(A, B, v.exact_E, v.name))
        remainder = plant.remainder and plant.remainder.mapped(
            lambda M: tuple(late.put(row, n, size + i) for row in M)
        )
        return replace(plant, vertices=tuple(vertices), remainder=remainder)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,  # noqa: ARG002
    ) -> proof.BoundClaim:
        """Return the claim about the margin."""
        return proof.DelayMargin.of(subject, self.loops, level, cover=self.cover)


@dataclass(frozen=True)
class DelayMargin(DiskMargin):
    """The delay margin of a loop at an input: it is stable if that is late by any time up to it.

    At a sample time it is late by any whole number of samples up to it.

    Attributes
    ----------
    signal : str
        The input.
    at_most : float, optional
        Of 1 over the margin [1/s]; `least` takes the margin itself, in seconds.
    cover : int
        Number of the disks with which it is proved, see `polefence.proof.covers`: a law is tuned
        with the first.
    """

    cover: int = 0
    kind = "delay margin"
    keys = ()  # type: ignore[assignment]
    vector: ClassVar[bool] = False
    by_gain: ClassVar[bool] = False
    claimed = proof.DelayMargin

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "sigma", -1.0)

    @property
    def title(self) -> str:
        """Kind and loop."""
        return f"{self.kind} of {self.name}"

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:  # type: ignore[override]
        """The filter of the limit."""
        return () if self.at_most is None else (_shape(Fraction(self.at_most), self.cover),)

    def unit(self, plant: UncertainPlant) -> str:
        """Return seconds; of samples that they are whole ones."""
        return "s, whole samples" if plant.period else "s"

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse what is no input, and less than a sample."""
        for name in self.names:
            if place_of(plant, name, None)[0] != "input":
                raise InputError(f"{self.title}: {name!r} is no input; name one")
        self.require_late(plant)
        T = plant.period
        if T and self.at_most is not None and not samples(1 / Fraction(self.at_most), T):
            raise InputError(
                f"{self.title} >= {exactly(self.limit or 0.0)}: at a sample time it is of whole "
                f"samples; ask for {exactly(float(T))} s or more"
            )

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has its filter."""
        return f"{self.title}: no LMI has it; leave out the method, so that a law is tuned"

    def posed(self, plant: UncertainPlant, law: Any) -> Posed:
        """Return the plant with its loop opened, the law beside it, and the gain to be bounded."""
        opened, beside, gain = super().posed(plant, law)
        known = {own.name: getattr(gain, own.name) for own in fields(gain)}
        return opened, beside, LateGain(**known, cover=self.cover)

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about the margin."""
        loops = self.loops_of(plant, subject.law)
        opened = opened_subject(subject, plant, loops)
        return proof.DelayMargin.of(opened, loops, level, cover=self.cover)

    def ways(
        self, plant: UncertainPlant, law: Any
    ) -> tuple[tuple[float | None, Specification], ...]:
        """Return it with each cover, that first with which samples have the largest margin."""
        covers = len(COVERS)
        if self.loops_of(plant, law).through:  # the code takes off what it sent, not what acts
            covers = 1
        each = sorted((self._nearest(plant, law, cover), cover) for cover in range(covers))
        return tuple((x, replace(self, cover=cover)) for x, cover in each if np.isfinite(x))

    def _nearest(self, plant: UncertainPlant, law: Any, cover: int) -> float:
        """Return the least level that a cover keeps, at samples; infinite where none is found."""
        alpha = seeded(plant, len(plant.vertices) + SAMPLES)
        margins = self.values(plant, law, alpha)
        worst, T = max(float(margins.max()), LEAST), float(plant.period)
        if not np.isfinite(worst):
            return np.inf
        some = alpha[np.unique([*range(len(plant.vertices)), *np.argsort(-margins)[:WORST]])]

        def keeps(level: float) -> bool:
            own = replace(self, at_most=level, cover=cover)
            posed, beside, gain = own.posed(plant, law)
            try:
                return bool(gain.values(posed, beside, some).max() < level)
            except (InputError, np.linalg.LinAlgError):  # not stable with the centre in it
                return False

        if T:
            low, high = 0, int(1 / worst / T * (1 + 1e-9)) + 1  # samples: kept, and not
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if keeps(_of_samples(middle, T)) else (low, middle)
            return _of_samples(low, T) if low else np.inf
        if not keeps(LARGEST * worst):
            return np.inf
        lost, most = 0.0, math.log(LARGEST)  # logarithms of levels: not kept, and kept
        for _ in range(HALVINGS):
            share = (lost + most) / 2 if lost else most / 8
            lost, most = (lost, share) if keeps(worst * math.exp(share)) else (share, most)
        return worst * math.exp(most)

    def unweighted(self) -> DiskMargin:
        """Return the disk margin of the loop itself."""
        return DiskMargin(self.signal, self.at_most, self.sigma)

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the loop without a filter: that of every limit is in `slopes`."""
        return self.unweighted().channel(plant, alpha)

    def slopes(self, loops: ClosedLoops) -> Slopes:
        """Return 1 over the margins that the first cover leaves, and their slopes."""
        points, w, _ = climbed(loops.modes, loops.E, loops.C, loops.F, _levels)
        found = Highest.of(loops, (points, w))
        values, rise = _levels(w, found.values), _rises(w, found.values)

        def turned() -> list[Turned]:
            own = (None if M is None else rise[:, None, None] * M for M in found.turned())
            return [Turned(*own)]  # type: ignore[arg-type]

        return Slopes(values, found.points, turned)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return 1 over the margin at points alpha, zero where there is no limit to it."""
        found = self.sampled(plant, law, alpha)
        with np.errstate(divide="ignore"):
            level = np.asarray(1 / found.delay.value)
        return np.where(found.stable, level, np.inf)
