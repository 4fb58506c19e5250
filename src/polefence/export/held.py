"""A law as code has it, in one kind of numbers, and whether its region is proved with that.

`FloatCode` and `FixedCode` answer the latter for laws that are found: see `polefence.optimise`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Protocol

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.design import Design
from polefence.certify.margins.claims import claimed_design
from polefence.export.documents import names, of_signals
from polefence.export.guarantee import Guarantee, guarantee, roundings
from polefence.export.memory import kept, with_rates
from polefence.export.program import (
    WORDS,
    Memory,
    Number,
    Program,
    amid,
    code_law,
    number,
    with_memory,
)
from polefence.export.program import program as program_of
from polefence.export.solved import SPENT, solved_in_words
from polefence.export.words import in_words
from polefence.law.laws import Law
from polefence.plant.larger import MEASURED
from polefence.plant.parameters import Parameter
from polefence.proof.claims.rounding import rounding_error
from polefence.proof.work import FormatError
from polefence.region.text import digits_down, digits_up
from polefence.requirements.specification import Specification

LONGEST = 52  # bits that are looked at for enough: doubles hold such integers
# Of a signal whose rms is limited, its range: noise is beyond it a part of 2e-9 of the time.
PEAK = 6
PEAKS = "initial peak", "energy peak"
# Of the fastest rate of a law's own states, the time in which they are stepped where no sample time
# is known; and how many of the octave below it are tried. The integers are scaled with it by powers
# of two, so that all times are as these; between them errors in 16 bits are 1 to 1.5 times the
# least, of the van's law of order 2, which is proved at five of eight.
STEP, OCTAVE = 0.1, 8


class Code(Protocol):
    """Whether a region is proved for the law of a design as code of one kind computes it."""

    refused: int

    @property
    def numbers(self) -> str:
        """What it computes with, in a word."""

    @property
    def remedy(self) -> str:
        """What to take in its place."""

    def __call__(self, design: Design) -> bool:
        """Whether it is proved."""

    def guarantee(self, design: Design) -> Guarantee:
        """Return what is proved of the code of a design's law."""


class FloatCode:
    """Whether a region is proved for the law of a design as float code computes it.

    For ``bears`` of `polefence.optimise`. Of a plant in continuous time the steps of a law's own
    states, which depend on the sample time of the export, are left out.

    Parameters
    ----------
    bits : int
        32 or 64.

    Attributes
    ----------
    refused : int
        Designs for which it was not proved.
    """

    def __init__(self, bits: int) -> None:
        self.number: Number = number(bits)
        self.refused = 0

    @property
    def numbers(self) -> str:
        """What it computes with, in a word."""
        return f"float{self.number.bits}"

    @property
    def remedy(self) -> str:
        """What to take in its place."""
        return "; or take --float 64" if self.number.bits == 32 else ""

    def __call__(self, design: Design) -> bool:
        """Whether it is proved."""
        proved = self.guarantee(design).proved
        self.refused += not proved
        return proved

    def guarantee(self, design: Design) -> Guarantee:
        """Return what is proved of the code of a design's law."""
        design = with_rates(design)
        law, plant = code_law(design.law), design.plant
        try:
            made = program_of(law, () if law.fixed else plant.parameters, self.number)
            if plant.period:
                made = with_memory(made, kept(design), float(plant.period))
        except InputError as problem:
            return Guarantee(design, inf, -1.0, None, str(problem))
        return guarantee(design, amid(made, law))


class FixedCode:
    """Whether a region is proved for the law of a design as code in fixed point computes it.

    For ``bears`` of `polefence.optimise`. States of a law's own for a plant in continuous time are
    stepped in a tenth of the time of their fastest rate, or down to half of that: at eight such
    times it has to be proved.

    Parameters
    ----------
    bits : int
        16 or 32.
    ranges : mapping
        The largest absolute value of each signal that is measured, by its name, in its unit.
    limits : iterable of Specification
        Of a signal without a range: its limited peak, or six times its limited rms.

    Attributes
    ----------
    refused : int
        Designs for which it was not proved.
    """

    def __init__(
        self,
        bits: int,
        ranges: Mapping[str, float] | None = None,
        limits: Iterable[Specification] = (),
    ) -> None:
        if bits not in WORDS:
            raise InputError(f"fixed = {bits!r} is not supported; use 16 or 32")
        self.bits, self.refused = bits, 0
        self.ranges = ranges_within(limits) | dict(ranges or {})

    @property
    def numbers(self) -> str:
        """What it computes with, in a word."""
        return f"fixed{self.bits}"

    @property
    def remedy(self) -> str:
        """What to take in its place."""
        return "; or take --fixed 32" if self.bits == 16 else "; or take --float"

    def require(self, signals: Iterable[str]) -> None:
        """Refuse signals that are measured and have no range.

        Raises
        ------
        InputError
            If one has none.
        """
        missing = [name for name in signals if self._range(name) is None]
        if missing:
            raise InputError(
                f"--fixed {self.bits} needs the range of {', '.join(missing)}: give the largest "
                f"absolute value of each in its unit, such as --range '{missing[0]} = 0.1', or a "
                "limit on it in the spec"
            )

    def _range(self, name: str) -> float | None:
        """Return the range of a signal; that of what a sensor says is its signal's."""
        return self.ranges.get(name, self.ranges.get(name.removeprefix(MEASURED)))

    def __call__(self, design: Design) -> bool:
        """Whether it is proved."""
        proved = self.guarantee(design).proved
        self.refused += not proved
        return proved

    def guarantee(self, design: Design) -> Guarantee:
        """Return what is proved of the code of a design's law.

        Raises
        ------
        InputError
            If a signal that is measured has no range.
        """
        design = of_signals(with_rates(design))
        law, plant, order = code_law(design.law), design.plant, kept(design)
        signals, _ = names(design)
        bare = [name.split(" [")[0] for name in signals]
        self.require(bare[: len(bare) - order])
        known = {name: self._range(name) for name in bare}
        ranges = {name: size for name, size in known.items() if size is not None}
        parameters = () if law.fixed else plant.parameters
        times = [float(plant.period)]
        if order and not times[0]:
            times = [_step(law, order) * 2 ** (-k / OCTAVE) for k in range(OCTAVE)]
        found = list[Guarantee]()
        for period in times:
            try:
                made = Words(design, parameters, (), ranges, order, period).program(self.bits)
            except InputError as problem:
                return Guarantee(design, inf, -1.0, None, str(problem))
            found.append(guarantee(design, made))
            if not found[-1].proved:
                return found[-1]
        return max(found, key=lambda one: one.share)


def ranges_within(limits: Iterable[Specification]) -> dict[str, float]:
    """Return the ranges of signals whose peaks or rms are limited."""
    ranges = dict[str, float]()
    for limit in limits:
        if limit.at_most is None or (limit.kind not in PEAKS and limit.kind != "rms"):
            continue
        size = limit.at_most * (1 if limit.kind in PEAKS else PEAK)
        ranges[limit.name] = min(size, ranges.get(limit.name, inf))
    return ranges


def _step(law: Law, order: int) -> float:
    """Return a time in which a law's own states of a plant in continuous time are stepped [s]."""
    gains = law.own_gain(np.eye(law.domain.corners)) if law.K is None else law.own_gain(None)
    rates = np.reshape(gains, (-1, *np.shape(gains)[-2:]))[:, -order:, -order:]
    fastest = float(np.abs(np.linalg.eigvals(rates)).max())
    return STEP / fastest if fastest > 0 else STEP


@dataclass(frozen=True, eq=False)
class Words:
    """A law for code in fixed point, and what its scales are found from.

    Attributes
    ----------
    design : Design
    parameters : tuple of Parameter
        What the code is given.
    cuts : tuple of float
        Limits of the inputs; none of none.
    ranges : mapping
        The largest absolute value of each signal, by its name.
    order : int
        How many states the code keeps itself.
    period : float
        From one update to the next [s], where it keeps any.
    """

    design: Design
    parameters: tuple[Parameter, ...]
    cuts: tuple[float, ...]
    ranges: Mapping[str, float]
    order: int
    period: float

    def program(self, bits: int) -> Program:
        """Return it in integers of so many bits.

        Raises
        ------
        InputError
            If these have no room for what the code computes.
        """
        made = self._held(bits)
        if not isinstance(made, str):
            return made
        lengths = (b for b in range(bits + 1, LONGEST + 1) if not isinstance(self._held(b), str))
        raise InputError(f"--fixed {bits} cannot hold the law: {made}{_needs(next(lengths, None))}")

    def _held(self, bits: int) -> Program | str:
        """Return it, or why it has no room."""
        memory = Memory(self.order, self.period, self.period) if self.order else None
        signals, _ = names(self.design)
        law = code_law(self.design.law)
        asked = law, self.parameters, bits, signals, self.ranges, self.cuts
        if law.W is None:
            return in_words(*asked, memory)
        reason, claimed = "", claimed_design(self.design)
        for attempt in range(len(SPENT)):  # the finest scales that have room
            try:
                made = solved_in_words(*asked, attempt)
                if claimed is not None:
                    roundings(claimed, made)
            except FormatError as problem:
                reason = str(problem)
                continue
            return made
        return reason

    def require_room(self, bits: int, proof: Guarantee) -> None:
        """Refuse a word length where a longer one has room for the gains, and say which."""
        made = self._held(32)
        if bits == 32 or isinstance(made, str):
            return
        longer = guarantee(self.design, made)
        if longer.claim is None:
            return
        gain, tolerated = longer.claim.gain, longer.tolerated

        def is_enough(length: int) -> bool:
            made = self._held(length)
            if isinstance(made, str):
                return False
            (other,) = roundings(longer.design, made)
            # in the scales of what is proved
            return float(rounding_error(replace(other.blank, gain=gain))) < tolerated

        lengths = range(bits + 1, 32)
        needed = bits + 1 + bisect_left(lengths, True, key=is_enough)
        allowed = digits_down(proof.tolerated, 2) if proof.tolerated > 0 else "none"
        raise InputError(
            f"--fixed {bits} cannot hold the gains: rounding may change them by "
            f"{digits_up(proof.rounding, 2)}, and {allowed} is proved to leave the poles in the "
            f"region{_needs(needed)}"
        )


def _needs(length: int | None) -> str:
    """Say which bits are enough, and what to take."""
    if length is None:
        return "; take --float"
    return f"; it needs {length} bits: take {'--fixed 32, or ' if length <= 32 else ''}--float"
