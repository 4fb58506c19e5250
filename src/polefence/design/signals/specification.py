"""Specifications on signals: what is to be small, or to stay within a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, cast

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.design.signals.baseline import Baseline, baseline
from polefence.lmi.conditions import performance as conditions
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal
from polefence.plant.polynomial import Domain, Polynomial
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.laws import Evidence, Law
from polefence.proof.matrices import Rationals
from polefence.proof.text import exactly
from polefence.response.weighting import WF, WK

WEIGHTS = {"Wk": WK, "Wf": WF}


@dataclass(frozen=True)
class Specification:
    """A signal, and the largest value that it may have; None where it is to be small.

    Attributes
    ----------
    signal : str or Output
        A state, an input or an output.
    at_most : float, optional
        In the signal's unit.

    Raises
    ------
    InputError
        If the limit is no positive number.
    """

    signal: str | Output | Signal
    at_most: float | None = None

    def __post_init__(self) -> None:
        value = self.at_most
        if value is not None and not (is_number(value) and value > 0):
            raise InputError(f"at_most = {value!r} of {self.name!r} must be a positive number")

    @property
    def name(self) -> str:
        """The signal's name."""
        return self.signal if isinstance(self.signal, str) else self.signal.name

    @property
    def kind(self) -> str:
        """What of the signal is bounded."""
        raise NotImplementedError

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:
        """Return what moves the signal."""
        raise NotImplementedError

    def exact_output(self, plant: UncertainPlant) -> proof.Output:
        """Return the signal in exact rationals."""
        return proof.Output(*rows(plant, signal_of(plant, self)), self.name)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim that the bound is kept."""
        raise NotImplementedError


@dataclass(frozen=True)
class Rms(Specification):
    """The worst rms of a signal for white disturbances.

    Attributes
    ----------
    density : float
        One-sided density of the disturbance [its unit squared per Hz]; of a road's velocity see
        `polefence.vehicle.velocity_density`.
    weight : str, optional
        "Wk" or "Wf" of ISO 2631-1: the rms of the signal so weighted.
        `polefence.design.signals.optimise` puts the filter into the plant.
    """

    density: float = 1.0
    weight: str | None = None
    kind = "rms"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.density) and self.density > 0):
            raise InputError(f"density = {self.density!r} must be a positive number")
        if self.weight is not None and self.weight not in WEIGHTS:
            raise InputError(
                f"weight = {self.weight!r} is unknown; {suggest(str(self.weight), WEIGHTS)}"
            )

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:
        """Return white noise."""
        return conditions.noise(
            f"noise {self.density:g}", domain, disturbance(plant), self.density / 2
        )

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the rms."""
        return proof.Rms(subject, self.exact_output(plant), level, Fraction(self.density) / 2)


@dataclass(frozen=True)
class RelativeRms(Rms):
    """The worst ratio of a signal's rms to its rms without control, at the same parameters.

    ``at_most`` is a number without unit. The plant without control must be stable.
    """

    kind = "relative rms"

    def square(self, plant: UncertainPlant, domain: Domain, C: Array) -> Polynomial:
        """Return a polynomial that is less than the variance without control."""
        return self._baseline(plant, domain).variance(domain, C)

    def _baseline(self, plant: UncertainPlant, domain: Domain) -> Baseline:
        on = "box" if len(domain.sizes) > 1 else "simplex"
        disturbance(plant)
        return baseline(plant, on, self.density / 2)

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about the ratio."""
        domain = Domain.of(subject.on, len(subject.A))
        stability, covariance = self._baseline(plant, domain).evidence()
        n = len(subject.A[0])
        output = self.exact_output(plant)
        A, E, C = proof.baseline_loop(subject, output, None, tuple(range(n)))
        base = proof.Baseline(A, E, C, stability, covariance)
        return proof.RelativeRms(subject, output, level, base, Fraction(self.density) / 2)


@dataclass(frozen=True)
class EnergyPeak(Specification):
    """The largest value of a signal, from rest, for disturbances of bounded energy.

    Attributes
    ----------
    norm : float
        Root of the integral of w^2 over all time [the disturbance's unit times s^0.5].
    """

    norm: float = 1.0
    kind = "energy peak"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.norm) and self.norm > 0):
            raise InputError(f"norm = {self.norm!r} must be a positive number")

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:
        """Return disturbances of unit norm as noise: they ask the same of X."""
        return conditions.noise("energy", domain, disturbance(plant), 1.0)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the peak."""
        return proof.EnergyPeak(subject, self.exact_output(plant), level, Fraction(self.norm))


@dataclass(frozen=True)
class InitialPeak(Specification):
    """The largest value of a signal from given initial states, or after impulses.

    Attributes
    ----------
    points : tuple of tuple of float
        Initial states; with them their convex hull and their negatives.
    impulse : float
        Of the disturbance, at rest [its unit times s]; zero for none.
    ellipsoid : (n, n) nested tuple, optional
        X0, symmetric without negative eigenvalues, numbers or exact (Fraction): all initial states
        with x0' X0^-1 x0 <= 1. A diagonal X0 has the squares of the half-axes on it. A box is the
        hull of its corners: give them as ``points``.
    """

    points: tuple[tuple[float, ...], ...] = ()
    impulse: float = 0.0
    ellipsoid: tuple[tuple[float | Fraction, ...], ...] = ()
    kind = "initial peak"

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_square(self.name, self.ellipsoid)
        object.__setattr__(self, "ellipsoid", tuple(map(tuple, self.ellipsoid)))
        numbers = [
            self.impulse,
            *(x for own in (self.points, self.ellipsoid) for p in own for x in p),
        ]
        if not all(isinstance(x, Fraction) or is_number(x) for x in numbers) or not any(numbers):
            raise InputError(
                f"{self.name!r}: give points or an impulse, or an ellipsoid, finite numbers"
            )
        X0 = [[Fraction(x) for x in row] for row in self.ellipsoid]
        if [list(row) for row in zip(*X0, strict=True)] != X0 or not proof.is_semidefinite(X0):
            raise InputError(
                f"{self.name!r}: the ellipsoid must be symmetric, without negative eigenvalues"
            )

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:  # noqa: ARG002
        """Return the initial states."""
        N, n = len(plant.vertices), plant.shape[0]
        if any(len(point) != n for point in self.points):
            raise InputError(f"{self.name!r}: an initial state has {n} numbers")
        if self.ellipsoid and len(self.ellipsoid) != n:
            raise InputError(f"{self.name!r}: the ellipsoid must be {n} x {n}")
        found = [np.tile(np.array(p, dtype=float)[:, None], (N, 1, 1)) for p in self.points]
        if self.impulse:
            E = disturbance(plant)
            found += [self.impulse * E[:, :, k : k + 1] for k in range(E.shape[2])]
        X0 = np.array(self.ellipsoid, dtype=float) if self.ellipsoid else None
        name = f"points {hash((self.points, self.impulse, self.ellipsoid))}"
        return conditions.Points(name, tuple(found), X0)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the peak."""
        points = tuple(tuple(Fraction(x) for x in point) for point in self.points)
        q = len(subject.E[0][0]) if self.impulse else 0
        impulses = (Fraction(self.impulse),) * q
        X0 = tuple(tuple(Fraction(x) for x in row) for row in self.ellipsoid)
        return proof.InitialPeak(subject, self.exact_output(plant), level, points, impulses, X0)


@dataclass(frozen=True)
class Gain(Specification):
    """The L2 gain (H-infinity norm) from the disturbances to a signal."""

    kind = "gain"

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:  # noqa: ARG002
        """Return the way the disturbances enter."""
        return conditions.Through("gain", disturbance(plant))

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the gain."""
        return proof.Gain(subject, self.exact_output(plant), level)


def limit_text(own: Specification) -> str:
    """Return a specification and its limit, which reads back as it is."""
    text = f"{own.kind} of {own.name}"
    return text if own.at_most is None else f"{text} <= {exactly(own.at_most)}"


def _require_square(name: str, ellipsoid: Any) -> None:
    try:
        widths = [len(row) for row in ellipsoid]
    except TypeError:
        widths = [-1]
    if any(width != len(widths) for width in widths):
        raise InputError(f"{name!r}: the ellipsoid must be a square matrix, [[...], [...]]")


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def disturbance(plant: UncertainPlant) -> Array:
    """Return E at the vertices, (N, n, q).

    Raises
    ------
    InputError
        If the plant has none.
    """
    found = [v.E for v in plant.vertices]
    if any(E is None for E in found):
        raise InputError(
            f"{plant.name} says nowhere how a disturbance enters; give E: for every vertex, or in "
            "[matrices]"
        )
    return np.stack([E for E in found if E is not None])


def signal_of(plant: UncertainPlant, specification: Specification) -> Output:
    """Return the signal that a specification names.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    signal = specification.signal
    if isinstance(signal, str):
        return plant.signal(signal)
    return cast(Output, signal)  # of the norm of a gain a name alone


def rows(plant: UncertainPlant, signal: Output) -> tuple[list[Rationals], list[Rationals]]:
    """Return C and D of the signal at every vertex, exactly.

    Raises
    ------
    InputError
        If a disturbance passes straight into it.
    """
    if signal.F:
        raise InputError(f"a disturbance passes straight into {signal.name!r}")
    C, D, _ = signal.exact(plant)
    return [[list(row)] for row in C], [[list(row)] for row in D]


def floats(matrices: list[Rationals]) -> Array:
    """Return exact matrices as an array."""
    return np.array([[[float(x) for x in row] for row in M] for M in matrices])


def output_of(
    plant: UncertainPlant, domain: Domain, specification: Specification, unit: float | None = None
) -> tuple[conditions.Source, conditions.Output]:
    """Return a specification as a condition has it; with a ``unit`` its bound is not fixed."""
    C, D = rows(plant, signal_of(plant, specification))
    source = specification.source(plant, domain)
    level = specification.at_most if unit is None else unit
    # as in the claim: a disturbance of unit norm, and the output times the norm
    size = specification.norm if isinstance(specification, EnergyPeak) else 1.0
    label = f"{specification.kind} of {specification.name}"
    own = conditions.Output(
        label,
        source.name,
        size * floats(C),
        size * floats(D),
        1.0 if level is None else level,
        unit is None,
    )
    if isinstance(specification, RelativeRms):
        own = replace(own, square=specification.square(plant, domain, own.C))
    return source, own


def claim_of(
    plant: UncertainPlant,
    law: Law,
    on: str,
    specification: Specification,
    evidence: Evidence,
    level: Fraction,
) -> proof.BoundClaim:
    """Return a specification of a law as a claim, in exact rationals."""
    A, B, E = (
        [[list(row) for row in M] for M in matrices if M is not None]
        for matrices in (
            [v.exact_A for v in plant.vertices],
            [v.exact_B for v in plant.vertices],
            [v.exact_E for v in plant.vertices],
        )
    )
    subject = proof.Subject(A, B, E, law, evidence, on)
    return specification.claim(subject, level, plant)
