"""Specifications: what of a signal, or of the law, is to be small or to stay within a limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self, cast

import numpy as np

from polefence.base.errors import InputError, SpecError, shown
from polefence.lmi.conditions import performance as conditions
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.laws import Evidence, Law
from polefence.proof.matrices import Rationals
from polefence.proof.text import exactly


@dataclass(frozen=True)
class Row:
    """A requirement as a spec, or a line, writes it.

    Attributes
    ----------
    table : mapping
        Its keys and values.
    where : str
        For messages.
    density : float, optional
        Of a disturbance that names none: that of the road, or of the spec's own tables.
    """

    table: Mapping[str, Any]
    where: str
    density: float | None = None

    def numbers(self, *keys: str) -> dict[str, float]:
        """Return those of the keys that are given, as numbers."""
        given = ("at_most", *keys)
        return {k: number(self.table[k], f"{self.where}: {k}") for k in given if k in self.table}


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

    keys: ClassVar[tuple[str, ...]] = ()  # of a table, besides kind, signal, at_most, minimise
    of_signal: ClassVar[bool] = True  # else of the law
    direct: ClassVar[bool] = False  # whether a disturbance may pass straight into the signal
    power: ClassVar[int] = 2  # of the bound, that grows with the r of a condition

    def __post_init__(self) -> None:
        value = self.at_most
        if value is not None and not (is_number(value) and value > 0):
            raise InputError(f"at_most = {value!r} of {self.name!r} must be a positive number")

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says.

        Raises
        ------
        InputError
            Naming the value that cannot be used.
        """
        return cls(row.table["signal"], **row.numbers())

    @property
    def name(self) -> str:
        """The signal's name."""
        return self.signal if isinstance(self.signal, str) else self.signal.name

    @property
    def kind(self) -> str:
        """What of the signal is bounded."""
        raise NotImplementedError

    @property
    def filter(self) -> str | None:
        """Name of the filter that the signal goes through first."""
        return None

    def filtered(self, signal: Output) -> Specification:
        """Return it of the signal behind its filter."""
        return replace(self, signal=signal)

    def unweighted(self) -> Specification:
        """Return it of the signal itself."""
        return self

    def extended(self, n: int, more: int) -> Specification:  # noqa: ARG002
        """Return it for a plant with more states behind its n, which are at rest at first."""
        return self

    def as_noise(self, bandwidth: float) -> Specification:  # noqa: ARG002
        """Return what an rms would have to be for it, of noise in a band [rad/s]."""
        return self

    def absolute(self) -> Specification:
        """Return what it bounds without comparison with another law."""
        return self

    def level(self, r: float) -> float:
        """Return the bound that a condition's r is, where it has no limit."""
        return float(r if self.power == 1 else math.sqrt(r))

    def output(self, plant: UncertainPlant) -> Output:
        """Return the signal.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        if isinstance(self.signal, str):
            return plant.signal(self.signal)
        return cast(Output, self.signal)  # one on the law has none, and is not asked

    def unit(self, plant: UncertainPlant) -> str:
        """Return the unit of the bound."""
        return self.output(plant).unit

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without the signal, or without what moves it.

        Raises
        ------
        InputError
            Saying what is missing.
        """
        self.output(plant)
        disturbance(plant)

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:
        """Return what moves the signal."""
        raise NotImplementedError

    def condition(
        self, plant: UncertainPlant, domain: Domain, unit: float | None = None
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return it as an LMI has it; with a ``unit`` its bound is not fixed."""
        C, D = rows(plant, self.output(plant), self.direct)
        source, level = self.source(plant, domain), self.at_most if unit is None else unit
        label = f"{self.kind} of {self.name}"
        level = 1.0 if level is None else level
        return source, conditions.Output(
            label, source.name, floats(C), floats(D), level, unit is None
        )

    def exact_output(self, plant: UncertainPlant) -> proof.Output:
        """Return the signal in exact rationals."""
        return proof.Output(*rows(plant, self.output(plant), self.direct), self.name)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim that the bound is kept."""
        raise NotImplementedError

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return what is bounded at points alpha (count, N), in floats.

        Raises
        ------
        InputError
            If a loop is not stable, or a response cannot be computed.
        """
        raise NotImplementedError


def limit_text(own: Specification) -> str:
    """Return a specification and its limit, which reads back as it is."""
    text = f"{own.kind} of {own.name}"
    return text if own.at_most is None else f"{text} <= {exactly(own.at_most)}"


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def number(value: Any, where: str) -> float:
    """Return a spec's number in floats.

    Raises
    ------
    SpecError
        If it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | Fraction):
        raise SpecError(f"{where} = {shown(value)} must be a finite number, without quotes")
    try:
        return float(value)
    except OverflowError as error:
        raise SpecError(f"{where} is too large a number") from error


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


def rows(
    plant: UncertainPlant, signal: Output, direct: bool = False
) -> tuple[list[Rationals], list[Rationals]]:
    """Return C and D of the signal at every vertex, exactly.

    Raises
    ------
    InputError
        If a disturbance passes straight into it, unless it may.
    """
    if signal.F and not direct:
        raise InputError(f"a disturbance passes straight into {signal.name!r}")
    C, D, _ = signal.exact(plant)
    return [[list(row)] for row in C], [[list(row)] for row in D]


def floats(matrices: list[Rationals]) -> Array:
    """Return exact matrices as an array."""
    return np.array([[[float(x) for x in row] for row in M] for M in matrices])


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
