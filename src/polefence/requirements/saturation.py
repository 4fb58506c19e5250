"""Inputs that saturate, or their rates: the least limit at which the loop still comes to rest.

From initial states, or from rest under disturbances of bounded energy. A set of states that is
larger asks for a limit that is larger by the same factor: where a limit of U is there and u is
proved to be enough, U / u times the set is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Self

import numpy as np

from polefence.base.errors import InputError, SpecError, shown
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, inputs, stacked, weighted_sum
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.saturation import MAX_INPUTS
from polefence.proof.text import exactly
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.initial_peak import InitialPeak, axes_of
from polefence.requirements.slopes import Loops, Slopes
from polefence.requirements.specification import (
    LARGEST,
    SMALLEST,
    Row,
    Specification,
    is_number,
    number,
)
from polefence.response.closed import Loops as Closed
from polefence.response.closed import close

LEVELS = 10  # parts of an interval of limits at which a loop is simulated, divided again and again


class _AtSamples(EnergyPeak):
    """The peak of an input: it changes at samples alone, and is bounded for held disturbances."""

    at_all_times = False


class _FromStatesAtSamples(InitialPeak):
    """The same from initial states."""

    at_all_times = False


@dataclass(frozen=True)
class Saturation(InitialPeak):
    """The least limit of an input, or of its rate, at which the loop still comes to rest.

    Or of several: of each signal that an input moves directly, by constants, and no disturbance. An
    input is held back so that all of them stay within the limit.

    Attributes
    ----------
    points, impulse, ellipsoid
        Initial states, as `InitialPeak` has them.
    norm : float
        In place of initial states, from rest: of disturbances in L2, at most [the disturbance's
        unit times s^0.5]; zero for none.
    limits : tuple of float
        Of each of several signals, in its unit: what is bounded is the largest share of its limit
        that one takes. Without, all have one limit.
    """

    norm: float = 0.0
    limits: tuple[float, ...] = ()
    kind = "saturation"
    keys = ("points", "impulse", "ellipsoid", "norm", "limits", "disturbances")
    at_all_times = False
    vector = True

    @explained_fields
    def __post_init__(self) -> None:
        if not (is_number(self.norm) and self.norm >= 0):
            raise InputError(f"norm = {self.norm!r} must be a number, zero or more")
        super().__post_init__()
        self._settle("limits", tuple(self.limits))
        if self.limits and len(self.limits) != len(self.entries):
            raise InputError(
                f"{self.name!r}: limits has {len(self.limits)} numbers for {len(self.entries)} "
                "signals; give one each"
            )
        if not all(is_number(x) and SMALLEST <= x <= LARGEST for x in self.limits):
            raise InputError(
                f"{self.name!r}: limits = {list(self.limits)} must be numbers from {SMALLEST:g} to "
                f"{LARGEST:g}, in the signals' units"
            )
        if self.norm and (self.points or self.impulse or self.ellipsoid):
            raise InputError(
                f"{self.name!r}: give initial states, or a norm of disturbances: then the loop "
                "begins at rest"
            )

    @property
    def _sizes(self) -> tuple[float, ...]:
        return self.impulse, self.norm

    @property
    def title(self) -> str:
        """Kind, signals and their limits."""
        numbers = ", ".join(map(exactly, self.limits))
        return f"{super().title} at [{numbers}]" if self.limits else super().title

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        limits = row.table.get("limits", [])
        if not isinstance(limits, list):
            raise SpecError(
                f"limits = {shown(limits)} must be a list, a number for each signal: [4, 40]"
            )
        limits = tuple(number(x, "limits") for x in limits)
        return replace(super().read(row), limits=limits)

    def outputs(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return the signals, as shares of their limits where these are given."""
        signals = self.signals(plant)
        if not self.limits:
            return signals
        return tuple(
            weighted_sum(
                f"{y.name} over {exactly(x)} {y.unit}".rstrip(), "", [(1 / Fraction(x), y)]
            )
            for y, x in zip(signals, self.limits, strict=True)
        )

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse signals that are no inputs, too."""
        super().require_fit(plant)
        self.cut_off(plant)
        if self.norm:
            self.entering(plant)

    def passed(self, plant: UncertainPlant, F: Array) -> Array:
        """Return of what passes into a law's signals what disturbances of a norm do."""
        return np.asarray(self.scaled(plant, F)) if self.norm else super().passed(plant, F)

    def cut_off(self, plant: UncertainPlant) -> tuple[int, ...]:
        """Return the numbers of the inputs that are held back, each once.

        Raises
        ------
        InputError
            If no input moves a signal, or there are too many.
        """
        signals = self.outputs(plant)
        if len(signals) > MAX_INPUTS:
            raise InputError(f"saturation of {len(signals)} signals; at most {MAX_INPUTS}")
        return tuple(dict.fromkeys(_moving(plant, signal) for signal in signals))

    def source(
        self, plant: UncertainPlant, domain: Domain, law: Law | None = None
    ) -> conditions.Source:
        """Return the initial states, or disturbances of unit norm as noise."""
        if self.norm:
            (E, degree), scales = self.driving(plant, law), self.scales(plant)
            name = f"saturation {self.norm} {scales}"
            return conditions.noise(name, domain, self.norm * E, 1.0, degree)
        self._require_states(plant)
        return self._starts(plant, "saturation", law)

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,
        unit: float | None = None,
        law: Law | None = None,
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return it with the numbers of the inputs that are held back."""
        source, output = super().condition(plant, domain, unit, law)
        return source, replace(output, held=self.cut_off(plant))

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim, with the auxiliary inputs of its evidence."""
        held, chosen = subject.evidence.held, self.cut_off(plant)
        Y = tuple(tuple(tuple(M[i]) for i in chosen) for M in held)
        degree = subject.evidence.held_degree
        subject = replace(subject, evidence=replace(subject.evidence, held=(), held_degree=0))
        claim = proof.Saturation(
            subject, self.exact_outputs(plant), level, held=Y, held_degree=degree
        )
        if self.norm:
            scales = self.scales(plant) or (1.0,) * plant.disturbance_count
            return replace(claim, norms=tuple(Fraction(self.norm) * Fraction(s) for s in scales))
        points, impulses, X0 = self._exact(plant)
        return replace(claim, points=points, impulses=impulses, ellipsoid=X0)

    def tuned(self, times: float) -> tuple[Specification, ...]:
        """Return limits on the unsaturated inputs' peaks, multiples of the saturation limit."""
        level = None if self.at_most is None else times * self.at_most
        common: dict[str, Any] = {"disturbances": self.disturbances}
        if level == np.inf:
            return ()
        units = self.limits or (1.0,) * len(self.entries)
        pairs = [
            (signal, None if level is None else unit * level)
            for signal, unit in zip(self.entries, units, strict=True)
        ]
        if self.norm:
            return tuple(_AtSamples(y, most, norm=self.norm, **common) for y, most in pairs)
        common |= {"points": self.points, "impulse": self.impulse, "ellipsoid": self.ellipsoid}
        return tuple(_FromStatesAtSamples(y, most, **common) for y, most in pairs)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return limits at which simulated loops do not come to rest, zero where none is found.

        At some of the points, from initial states; of disturbances no worst one is looked for.
        """
        limits = np.zeros(len(alpha))
        if self.norm:
            return limits
        at = np.unique(np.linspace(0, len(alpha) - 1, 300).astype(int))
        plant = delta_form(plant)
        loops, step = close(plant, law, alpha[at], disturbed=False), float(plant.step)
        axes = [np.tile(axis, (len(at), 1)) for axis in axes_of(self)]
        C, D = (M[0] for M in stacked(plant, self.outputs(plant))[:2])
        gain = getattr(law, "anti_windup", None)
        limits[at] = _least_limits(loops, [*self.begun(loops), *axes], (C, D), step, gain)
        return limits

    def slopes(self, loops: Loops) -> Slopes:  # noqa: ARG002
        """Refuse: what a loop does when it is cut off has no slopes.

        Raises
        ------
        InputError
        """
        raise InputError(
            f"{self.title}: a saturated input has no slopes; its peaks have, as `tuned` says"
        )


def _moving(plant: UncertainPlant, signal: Output) -> int:
    """Return the number of the input that moves a signal, and nothing else of it but states.

    Raises
    ------
    InputError
        If there is none.
    """
    C, D, F = signal.exact(plant)
    names = [own.name for own in inputs(plant)]
    moving = [j for j, x in enumerate(D[0]) if x]
    if not any(map(any, D)):
        why = f"none of {', '.join(names)} moves it directly"
    elif any(map(any, F)):
        why = "a disturbance passes straight into it"
    elif len({*C}) > 1 or len({*D}) > 1:
        why = "it changes with the parameters"
    elif len(moving) > 1:
        why = f"{names[moving[0]]} and {names[moving[1]]} move it; one input is held back for it"
    else:
        return moving[0]
    raise InputError(
        f"saturation of {signal.name!r}: {why}; it is of an input, or of the rate of one"
    )


def _least_limits(
    loops: Closed,
    starts: list[Array],
    signals: tuple[Array, Array],
    step: float,
    gain: Array | None,
) -> Array:
    """Return for each loop the largest limit at which its simulation does not settle.

    Parameters
    ----------
    starts : list of (loops, n) arrays
    signals : (p, n) and (p, m) arrays
        What saturates, C x + D u, each moved by one input.
    gain : (n, m) array, optional
        Of the law's anti-windup.
    """
    A, B, K, poles = loops.A, loops.B, loops.K, loops.poles()
    fastest = np.abs(np.concatenate([poles, np.linalg.eigvals(A)], axis=-1)).max()
    # how fast it comes to rest, or is lost where nothing acts
    rates = np.concatenate([-poles.real, np.abs(np.linalg.eigvals(A).real)], axis=-1)
    slowest = float(rates[rates > 1e-6 * float(fastest)].min(initial=float(fastest)))
    dt = step or 0.1 / float(fastest)
    steps = int(min(6.0 / slowest / dt + 1, 1500))  # six time constants of the slowest pole
    x0 = np.stack(starts)
    A, B, K = (np.swapaxes(M, 1, 2) for M in (A, B, K))  # to be multiplied from the left
    size = np.linalg.norm(x0, axis=-1)
    (C, D), back = signals, None if gain is None else gain.T
    moving = [int(np.flatnonzero(row)[0]) for row in D]
    per = D[np.arange(len(D)), moving]

    def run(limit: Array) -> tuple[Array, Array]:
        """Return whether loops diverge at limits (..., starts, loops), and their largest demand."""
        x = np.broadcast_to(x0, (*limit.shape, x0.shape[2]))[..., None, :]
        most, cut = np.zeros(limit.shape), limit[..., None, None]
        before = most
        for k in range(steps):
            asked = x @ K
            most = np.maximum(most, np.abs(x @ C.T + asked @ D.T).max(axis=(-1, -2)))
            u = asked.copy()
            for c, j, d in zip(C, moving, per, strict=True):
                middle, half = -(x @ c) / d, cut[..., 0] / abs(d)
                u[..., j] = np.clip(u[..., j], middle - half, middle + half)
            slope = x @ A + u @ B + (0.0 if back is None else (u - asked) @ back)
            if not step:  # the input held within a step
                slope = slope + dt / 2 * slope @ A
            x = np.clip(x + dt * slope, -1e100, 1e100)
            if k == steps // 2:
                before = np.linalg.norm(x, axis=(-1, -2))
        end = np.linalg.norm(x, axis=(-1, -2))
        # a state that has grown tenfold, and grows on, does not settle
        return (end > 10.0 * size) & (end > before), most

    _, high = run(np.full(size.shape, np.inf))
    low = np.zeros(size.shape)
    shares = np.arange(1, LEVELS)[:, None, None] / LEVELS
    for _ in range(3):
        lost, _ = run(low + shares * (high - low))
        count = np.where(lost, shares * LEVELS, 0.0).max(axis=0)  # of the highest at which it is
        low, high = (low + (count + k) / LEVELS * (high - low) for k in (0, 1))
    return np.asarray(low.max(axis=0))
