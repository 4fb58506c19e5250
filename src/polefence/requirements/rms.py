"""Rms of a signal under white noise, weighted or not, of all frequencies or of a band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

import numpy as np

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.dual_problem import DualProblem, OverPeriod
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.between import MOST_PERIODS, Held
from polefence.requirements.frequencies import (
    frequencies,
    require_below_half_the_rate,
    with_band,
)
from polefence.requirements.slopes import Channel, Loops, Slopes, of_noise
from polefence.requirements.specification import Row, Specification, is_number, listed
from polefence.requirements.weights import (
    WEIGHTS,
    behind,
    filters_of,
    parts,
    wider,
    with_weights,
)
from polefence.response.between import factor, held_of, means
from polefence.response.closed import Loops as Closed
from polefence.response.closed import close
from polefence.response.modes import Modes
from polefence.response.stationary import lyapunov, needed, stationary, unstable
from polefence.response.weighting import BandFilter, Stages, in_series

WIDE = 1.6  # times the shortest period, from which on one in between is looked at too

PLAIN = "none"  # of an entry that goes through no filter


@dataclass(frozen=True)
class Rms(Specification):
    """The worst rms of a signal for white disturbances; of a vector z, the root of E z'z.

    Attributes
    ----------
    density : float
        One-sided density of the disturbance [its unit squared per Hz]; of a road's velocity see
        `polefence.vehicle.velocity_density`.
    weight : str or sequence of str, optional
        "Wk", "Wd", "We" or "Wf" of ISO 2631-1: the rms of the signal so weighted, of a vector each
        entry; or one for each entry, "none" among them. The filters are no states of the plant:
        no law feeds them back, and the region is not about their poles.
    band : pair of float, optional
        [low, high] in Hz: the rms behind a Butterworth filter of this band, of third order at each
        end; with low = 0 behind a low-pass of fourth order. Behind the weighting where there is
        one, too.
    """

    density: float = 1.0
    weight: str | Sequence[str] | None = None
    band: Any = field(default=None, kw_only=True)
    kind = "rms"
    keys = ("density", "weight", "band", "disturbances")
    vector = True
    limits_rms = True
    late_as: ClassVar[str | None] = proof.Rms.late_as
    at_all_times: ClassVar[bool] = True  # of samples: between them too

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.density) and self.density > 0):
            raise InputError(f"density = {self.density!r} must be a positive number")
        if self.weight is not None:
            self._settle("weight", _weights(self.weight, len(self.entries)))
        if self.band is not None:
            self._settle("band", frequencies(self.band))

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a band that samples cannot have, too."""
        super().require_fit(plant)
        if self.band is not None:
            require_below_half_the_rate(self.title, self.band, plant)

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says; the road says the density of one that has none."""
        weight = row.table.get("weight")
        names = weight if isinstance(weight, list) else [weight]
        if weight is not None and not all(isinstance(name, str) for name in names):
            raise SpecError(
                f'{row.where}: weight = {shown(weight)} must be text, for example "Wk", or a list '
                "of them, one for each entry of the signal"
            )
        density = row.given("density").get("density", row.density)
        if density is None:
            density = cls.without_density(row.where)
        given = row.given() | {"density": density}
        return cls(row.table["signal"], **given, weight=weight, band=row.table.get("band"))

    @classmethod
    def without_density(cls, where: str) -> float:
        """Return the density that will do where none is given; refuse where none will."""
        raise SpecError(
            f"{where}: neither density nor a road is given; write density = D (on a line: with "
            "density D), one-sided, in the disturbance's unit squared per Hz, or for a car a table "
            "[road] with class and speed"
        )

    @property
    def filters(self) -> tuple[Stages | None, ...]:
        """The filters, one an entry: weighting, band, or both in series."""
        weight = self.weight
        names = (
            (weight,) * len(self.entries) if weight is None or isinstance(weight, str) else weight
        )
        band = () if self.band is None else (BandFilter(*self.band),)
        return tuple(
            in_series((*(() if name in (None, PLAIN) else (WEIGHTS[str(name)],)), *band))
            for name in names
        )

    @property
    def title(self) -> str:
        """Kind, signal, chosen disturbances, weight and band, as a line has them."""
        weight, text = self.weight, super().title
        if weight is not None:
            text = f"{text} with weight {weight if isinstance(weight, str) else listed(weight)}"
        return with_band(text, self.band)

    def filtered(self, signals: Sequence[str | Output]) -> Rms:
        """Return it of the weighted signals."""
        return replace(self, signal=signals, weight=None, band=None)

    def of(self, output: Output) -> Rms:
        """Return the rms of another output, with the filter of the signal of its name."""
        names = [entry if isinstance(entry, str) else entry.name for entry in self.entries]
        weight = self.weight
        if not (weight is None or isinstance(weight, str)):
            known = dict(zip(names, weight, strict=True))
            weight = None if known.get(output.name) == PLAIN else known.get(output.name)
        return replace(self, signal=output, weight=weight)

    def unweighted(self) -> Rms:
        """Return it of the signal itself."""
        return replace(self, weight=None, band=None)

    @property
    def noise_density(self) -> float:
        """The density."""
        return self.density

    @property
    def unnamed_noise(self) -> float:
        """Scale that makes the density 1."""
        return float(1 / np.sqrt(self.density))

    def source(
        self, plant: UncertainPlant, domain: Domain, law: Law | None = None
    ) -> conditions.Source:
        """Return white noise."""
        name = f"noise {self.density!r}{self.scales(plant) or ''}"
        E, degree = self.driving(plant, law)
        return conditions.noise(name, domain, E, self.density / 2, degree)

    def held(self, plant: UncertainPlant) -> Held | None:
        """Return what is held between samples, where the rms is that at all times."""
        if not self.at_all_times or any(self.filters):
            return None
        return held_of(plant, self.outputs(plant))

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the closed loops of the dual form."""
        problem, held = self._dual(plant, law, (self.density / 2) ** 0.5), self.held(plant)
        if held is None:
            return problem
        outputs = self.exact_outputs(plant)
        scales, intensity = tuple(map(Fraction, self.scales(plant))), Fraction(self.density) / 2
        period = held.period(outputs, scales, plant.period, intensity)
        means = OverPeriod(period, held.chosen_of(outputs), clock=held.clock)
        return replace(problem, means=means)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the rms."""
        scales, intensity = tuple(map(Fraction, self.scales(plant))), Fraction(self.density) / 2
        outputs, filters = self.exact_outputs(plant), filters_of(plant, self)
        held = self.held(plant)
        return proof.Rms(
            subject, outputs, level, intensity, scales=scales, filters=filters, held=held
        )

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the rms, by a Lyapunov equation at each point."""
        return of_one_noise(plant, law, [self], alpha)[0]

    def has_primal(self, plant: UncertainPlant) -> bool:
        """Not of what goes on between samples: a mean over a period is linear in the dual."""
        return self.held(plant) is None

    def at_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array | None:
        """Return the rms at samples alone, where what is bounded is that at all times."""
        if self.held(plant) is None:
            return None
        return of_one_noise_at_samples(plant, law, [self], alpha)[0]

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with disturbances of unit intensity, and with its filters."""
        wide = behind(plant, None, self)
        channel = Specification.channel(wide.specification, wide.plant, alpha)
        more = wide.plant.shape[0] - plant.shape[0]
        size = (self.density / 2) ** 0.5
        channel = replace(channel.louder(size), filters=more)
        if self.held(plant) is None:
            return channel
        longest, *others = (self.over(plant, alpha, length) for length in self.lengths(plant))
        return replace(longest, beside=tuple(others))

    def lengths(self, plant: UncertainPlant) -> list[float]:
        """Return periods that one Q is to do for, in sample times, the longest first."""
        held = self.held(plant)
        if held is None or held.clock is None:
            return [1.0]
        ends, middles = list(map(float, held.clock.ends)), list[float]()
        for span in held.clock.spans:
            if span.most >= WIDE * span.least:
                middles.append(float(span.least * span.most) ** 0.5)
        return sorted([*ends, *middles], reverse=True)

    def borne(self, plant: UncertainPlant, law: Any) -> int | None:
        """Return how many samples in a row may be lost, as loops at the corners with floats tell.

        With as many lost each time, and the longest period of the jitter, they are stable. None of
        a clock that is perfect; -1 where they are not stable even with none lost.
        """
        held = self.held(plant)
        if held is None or held.clock is None:
            return None
        plant, corners = delta_form(plant), np.eye(len(plant.vertices))
        loops = close(plant, law, corners)
        for lost in range(MOST_PERIODS):
            length = (1 + lost) * float(2 - held.clock.least)
            channel = self.over(plant, corners, length)
            if len(unstable(channel.A + channel.B @ loops.K, loops.step)):
                return lost - 1
        return MOST_PERIODS

    def over(self, plant: UncertainPlant, alpha: Array, length: float) -> Channel:
        """Return the channel of what goes on between samples so many sample times apart.

        Parameters
        ----------
        plant : UncertainPlant
            In its delta form.
        """
        channel = Specification.channel(self, plant, alpha)
        held = self.held(plant)
        if held is None:
            raise InputError(f"{self.title}: {plant.name} is no sampled plant")
        n, (count, m) = plant.shape[0], (len(alpha), plant.shape[1])
        outputs, scales = self.exact_outputs(plant), self.scales(plant)
        mean = means(plant, held, outputs, scales, self.density, alpha, length)
        E, rows = np.zeros((count, n, mean.V.shape[-1])), np.zeros((count, len(mean.chosen), n + m))
        E[:, : mean.V.shape[-1]] = length**0.5 * factor(mean.V)
        rows[:, :, mean.chosen] = np.swapaxes(factor(mean.M), 1, 2)
        F = np.zeros((count, rows.shape[1], E.shape[2]))
        A, B = channel.A, channel.B
        if length != 1:
            AB = np.concatenate([A, B], axis=2)
            AB[:, : mean.moved.shape[1]] = 0.0
            AB[:, : mean.moved.shape[1], mean.chosen] = mean.moved
            A, B = AB[..., :n], AB[..., n:]
        channel = replace(channel, A=A, B=B, E=E, C=rows[..., :n], D=rows[..., n:], F=F)
        return replace(channel, more=mean.c, length=length)

    def is_of_noise(self, channel: Channel) -> bool:  # noqa: ARG002
        """Whether `slopes` are those of noise: always."""
        return True

    def slopes(self, loops: Loops) -> Slopes:
        """Return the rms with its slopes."""
        return of_noise(loops)


def _weights(weight: str | Sequence[str], entries: int) -> str | tuple[str, ...] | None:
    """Return one weighting for all entries, or one for each."""
    if not isinstance(weight, str):
        weight = tuple(weight)
        if len(weight) != entries:
            raise InputError(
                f"weight names {len(weight)} for {entries} entries of the signal; name one for "
                f'each, "{PLAIN}" where an entry has none'
            )
    for name in (weight,) if isinstance(weight, str) else weight:
        if name not in WEIGHTS and (isinstance(weight, str) or name != PLAIN):
            raise InputError(f"weight = {name!r} is unknown; {suggest(str(name), WEIGHTS)}")
    if isinstance(weight, str):
        return weight
    return None if set(weight) == {PLAIN} else weight


def filtered_by(names: Sequence[str | None]) -> dict[str, Any]:
    """Return the weight and the band that filters of these names are, one an entry.

    Raises
    ------
    InputError
        If they are of no one band.
    """
    found = [() if name is None else parts(name) for name in names]
    bands = {tuple(one for one in filters if isinstance(one, BandFilter)) for filters in found}
    if len(bands) > 1 or any(len(band) > 1 for band in bands):
        raise InputError(f"{listed([str(name) for name in names])} are not of one band")
    weights = [[one.name for one in own if not isinstance(one, BandFilter)] for own in found]
    (band,) = next(iter(bands), ()) or (None,)
    return {
        "weight": [own[0] if own else PLAIN for own in weights] if any(weights) else None,
        "band": None if band is None else (band.low, band.high),
    }


def in_any_order(limit: Specification, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
    """Return what one Q proves of an rms at points, for periods of a clock in any order, in floats.

    Infinite where there is none; otherwise no more than 0.25 % above the least.
    """
    plant = delta_form(plant)
    channel, loops = limit.channel(plant, alpha), close(plant, law, alpha)
    closed = channel.closed(loops.K, Modes(channel.A + channel.B @ loops.K, loops.step))
    return limit.slopes(closed).values


def of_one_noise(
    plant: UncertainPlant, law: Any, limits: Sequence[Rms], alpha: Array
) -> list[Array]:
    """Return the values of several rms under the same noise, from one covariance.

    Raises
    ------
    InputError
        As `stationary` raises, of all of them together.
    """
    values = of_one_noise_at_samples(plant, law, limits, alpha)  # refuses what has none
    held = [k for k, limit in enumerate(limits) if limit.held(plant) is not None]
    if held:
        between = _Between(plant, close(plant, law, alpha), alpha)
        for k in held:
            values[k] = between.rms(limits[k])
    return values


def of_one_noise_at_samples(
    plant: UncertainPlant, law: Any, limits: Sequence[Rms], alpha: Array
) -> list[Array]:
    """Return the same at samples alone, of a plant that has some.

    Raises
    ------
    InputError
        As `stationary` raises, of all of them together.
    """
    psd, bare = limits[0].density * limits[0].squares(plant), plant
    plant, plain = with_weights(plant, limits)
    law = wider(law, bare, plant)
    outputs = [limit.outputs(plant) for limit in plain]
    signals = list(dict.fromkeys(signal for entries in outputs for signal in entries))
    rms = stationary(plant, law, alpha, psd, signals).rms
    columns = [[signals.index(signal) for signal in entries] for entries in outputs]
    return [np.asarray(np.linalg.norm(rms[:, those], axis=1)) for those in columns]


class _Between:
    """Rms values at all times, of signals under one noise, of loops at points of the family."""

    def __init__(self, plant: UncertainPlant, loops: Closed, alpha: Array) -> None:
        self.plant, self.loops, self.alpha = plant, loops, alpha
        # by the length of a period: whether no loop is stable then; and states that matter
        self._unstable = dict[float, bool]()
        self._covariances = dict[tuple[float, bytes], Array]()

    def rms(self, limit: Rms) -> Array:
        """Return the largest rms of a signal for periods that a clock may have."""
        lengths = dict.fromkeys((1.0, *limit.lengths(self.plant)))
        return np.asarray(np.max([self._of(limit, length) for length in lengths], axis=0))

    def _of(self, limit: Rms, length: float) -> Array:
        """Return it where every period is so many sample times; infinite if some is unstable."""
        channel, K = limit.over(delta_form(self.plant), self.alpha, length), self.loops.K
        closed, shown = channel.A + channel.B @ K, channel.C + channel.D @ K
        if length not in self._unstable:
            self._unstable[length] = bool(len(unstable(closed, self.loops.step)))
        if self._unstable[length] and length != 1:
            return np.full(len(self.alpha), np.inf)
        kept = needed(shown, closed)
        key = length, np.asarray(kept).tobytes()
        if key not in self._covariances:
            E = channel.E[:, kept]
            W = E @ np.swapaxes(E, 1, 2)
            self._covariances[key] = lyapunov(closed[:, kept][:, :, kept], W, self.loops.step)
        C, X = shown[:, :, kept], self._covariances[key]
        return np.asarray(np.sqrt(np.maximum(((C @ X) * C).sum(axis=(1, 2)) + channel.more, 0.0)))
