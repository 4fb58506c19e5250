"""Responses over time: how large, how fast and how calm a signal is after a start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from itertools import pairwise
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.measured import MAX_POINTS, RELATIVE, Envelope
from polefence.proof.text import exactly
from polefence.requirements.followed import times_of, unfollowed
from polefence.requirements.initial_peak import matrix
from polefence.requirements.slopes import ALIKE, Loops, Slopes, Turned
from polefence.requirements.specification import Row, Specification, is_number, number
from polefence.response.closed import close
from polefence.response.discrete import exponential
from polefence.response.modes import Modes

TIMES = ("settling", "rise")  # measures that are times
TINY, MOST, CLOSER = 1e-300, 3, 4  # a final value of none; times that count; steps to each
FINER = 41  # times between two, at each step to the worst of an envelope
FEW, TURN, TURNS = 150, 8, 20  # times of samples, see `times_of`
CLOSEST = 100  # samples that are worst, which are looked at more closely
Points = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Measured(Specification):
    """A measure of a signal's response; every kind says how that begins.

    Attributes
    ----------
    measure : str
    band : float, optional
    envelope : sequence of (float, float, float), optional
        Times [s], lower and upper numbers between which the signal is to stay: linear between the
        times, the last for ever after. What is bounded is how many times as wide it must be, about
        the same middle; its ``measure`` is "envelope".
    """

    measure: str = field(default="peak", kw_only=True)
    band: float | None = field(default=None, kw_only=True)
    envelope: Points = field(default=(), kw_only=True)
    keys: ClassVar[tuple[str, ...]] = ("measure", "band", "envelope", "disturbances")
    power = 1
    claimed: ClassVar[type[proof.MeasuredResponse]]
    bands: ClassVar[Mapping[str, float]] = MappingProxyType({})  # where none is named

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        self._settle("envelope", _points(self.envelope, self.name))
        if self.envelope and self.measure == "peak":
            self._settle("measure", "envelope")
        if self.measure not in self.claimed.measures:
            known = suggest(str(self.measure), list(self.claimed.measures))
            raise InputError(f"measure = {shown(self.measure)} of a {self.kind}: {known}")
        if bool(self.envelope) != (self.measure == "envelope"):
            raise InputError(_alone(self.measure))
        if self.measure in self.bands and self.band is None:
            self._settle("band", self.bands[self.measure])
        self._require_band()

    def _require_band(self) -> None:
        band = self.band
        if self.measure not in TIMES:
            if band is not None:
                raise InputError(f"band = {band!r}: it is of settling and rise times; leave it out")
            return
        positive = is_number(band) and band is not None and band > 0
        if self.claimed.has_final and not (positive and band is not None and band < 1):
            raise InputError(f"band = {band!r} must be above 0 and below 1, a share")
        if not positive:
            raise InputError(
                f"band = {band!r} of {self.name!r} must be a number above 0, in the signal's unit: "
                "band = 0.01"
            )

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        table = row.table
        own = {key: table[key] for key in ("measure",) if key in table}
        if "envelope" in table:
            if own.get("measure", "envelope") != "envelope":
                raise SpecError(_alone(own["measure"]))
            own["envelope"] = matrix(row, "envelope", "times, lower and upper numbers", number)
        own |= row.given(*({"band"} & set(table))) | cls._more(row)
        return cls(table["signal"], **own)

    @classmethod
    def _more(cls, row: Row) -> dict[str, Any]:  # noqa: ARG003
        """Return what a kind reads of its own."""
        return {}

    @property
    def title(self) -> str:
        """Kind, signal and measure, as a line has them."""
        band = f" with band {exactly(self.band)}" if self.band is not None else ""
        return f"{super().title} with measure {self.measure}{band}"

    @property
    def relative(self) -> bool:
        """Whether the measure is one beside the final value."""
        return self.claimed.has_final and self.measure in RELATIVE

    def unit(self, plant: UncertainPlant) -> str:
        """Return seconds, none of a share, or the signal's unit."""
        if self.measure in TIMES:
            return "s"
        return "" if self.relative or self.envelope else super().unit(plant)

    def sampled_text(self, level: float) -> str:
        """Return what is sampled; of a signal that comes back to zero no band is a share."""
        if np.isfinite(level) or not self.relative:
            return super().sampled_text(level)
        return "never (of a final value of zero ask for an envelope)"

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant of which none is proved."""
        self.require_late(plant)
        self.outputs(plant)
        if why := unfollowed(plant):
            raise InputError(f"{self.title}: {self.kind} responses are not proved {why}")
        self._require_begun(plant)

    def _require_begun(self, plant: UncertainPlant) -> None:
        """Refuse an envelope that the response leaves at once, whatever the law is."""
        if not self.envelope or self.envelope[0][0] > 0 or self.at_most is None:
            return
        channel = self.channel(plant, np.eye(len(plant.vertices)))
        if np.any(channel.D):
            return
        x0 = self.begun(channel.E)
        y = (channel.C[:, 0] * x0).sum(axis=1) + channel.F.sum(axis=(1, 2))
        _, lower, upper = self.envelope[0]
        over = np.abs(y - (upper + lower) / 2)
        k = int(over.argmax())
        if over[k] > self.at_most * (upper - lower) / 2:
            raise InputError(
                f"{self.title}: the envelope is from {lower:g} to {upper:g} at 0 s, and the "
                f"response begins at {y[k]:g}; widen it there, or begin it later"
            )

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.MeasuredResponse:
        """Return the claim, which is not followed yet."""
        return self.claimed(subject, self.exact_outputs(plant), level, **self._claimed(plant))

    def _claimed(self, plant: UncertainPlant) -> dict[str, Any]:
        """Return what a claim has beside its subject, outputs and level."""
        band = Fraction(0) if self.band is None else Fraction(repr(self.band))
        own: dict[str, Any] = {"measure": self.measure, "band": band}
        own |= {"scales": tuple(map(Fraction, self.scales(plant)))}
        if self.envelope:
            points = (tuple(Fraction(repr(x)) for x in point) for point in self.envelope)
            own["envelope"] = Envelope(tuple((t, low, high) for t, low, high in points))
        return own

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has it."""
        return f"{self.title}: no LMI has it; leave out the method, so that a law is tuned"

    def near(self, **own: Any) -> Specification:
        """Return how near the signal is from a time on, as `Near` has it."""
        raise NotImplementedError

    def tuned(self, times: float) -> tuple[Specification, ...]:  # noqa: ARG002
        """Return it, or of a time how near the signal is from the limit on.

        Raises
        ------
        InputError
            If a time is to be minimised.
        """
        if self.measure not in TIMES:
            return (self,)
        if self.at_most is None:
            raise InputError(
                f"{self.title}: a time is not minimised; give it a limit, at_most = 1.0 [s]"
            )
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return (self.near(**own | {"at_most": 1.0, "time": self.at_most}),)

    # --- values and slopes -----------------------------------------------------------------------

    def slopes(self, loops: Loops) -> Slopes:
        """Return the measure at the times that count, with its slopes."""
        final = self.claimed.has_final
        every = [self.response(loops, k) for k in range(len(loops.A))]
        active = [self.active(response) for response in every]
        points = np.repeat(np.arange(len(every)), [len(times) for times in active])
        t = np.concatenate(active)
        ends = np.array([response.final for response in every])[points]
        A, E, C = loops.A[points], loops.E[points].sum(axis=2), loops.C[points][:, 0]
        n, F = A.shape[1], loops.F[points].sum(axis=(1, 2))
        whole = np.zeros((len(points), n + 1, n + 1))  # of x and of one
        whole[:, :n, :n] = A
        whole[:, :n, n] = E * final
        begun = np.pad(self.begun(loops.E[points]), ((0, 0), (0, 1)), constant_values=1.0)
        row = np.pad(C, ((0, 0), (0, 1)))
        motion = (exponential(whole * t[:, None, None]) @ begun[..., None])[..., 0]
        y = (row * motion).sum(axis=1) + F
        values, of_y, of_final = self.measures(t, y, ends)

        def turned() -> list[Turned]:
            # the integral of e^A'(t - s) C' x0' e^A's over s, as a block of an exponential
            m = n + 1
            both = np.zeros((len(points), 2 * m, 2 * m))
            both[:, :m, :m] = both[:, m:, m:] = np.swapaxes(whole, 1, 2)
            both[:, :m, m:] = row[:, :, None] * begun[:, None]
            moved = exponential(both * t[:, None, None])
            d = moved[:, :m, m:] * of_y[:, None, None]
            dA, dC = d[:, :n, :n], of_y[:, None] * motion[:, :n]
            if final:
                q = np.linalg.solve(A, E[..., None])[..., 0]
                p = np.linalg.solve(np.swapaxes(A, 1, 2), C[..., None])[..., 0]
                dA = dA + of_final[:, None, None] * p[:, :, None] * q[:, None]
                dE, dC = d[:, :n, n] - of_final[:, None] * p, dC - of_final[:, None] * q
            else:
                back = (moved[:, :m, :m] @ row[..., None])[:, :n, 0]
                dE = of_y[:, None] * back
            dF = np.broadcast_to((of_y + of_final)[:, None, None], (len(t), 1, loops.F.shape[2]))
            columns = np.repeat(dE[:, :, None], loops.E.shape[2], axis=2)
            return [Turned(dA, dC[:, None], columns, dF)]

        return Slopes(values, points, turned)

    def active(self, response: Response) -> Array:
        """Return the times that count."""
        match self.measure:
            case "peak":
                return response.highest(np.abs(response.y))
            case "envelope":
                return response.farthest(lambda t: self._outside(t, response.at(t))[0], self._times)
            case _:
                return response.t[-1:]

    def measures(self, t: Array, y: Array, final: Array) -> tuple[Array, Array, Array]:
        """Return the measure of y at times, and its slopes to y and to the final value."""
        if self.measure == "envelope":
            return (*self._outside(t, y), np.zeros(len(y)))
        return np.abs(y), np.sign(y), np.zeros_like(final)

    @property
    def _times(self) -> Array:
        return np.array([t for t, _, _ in self.envelope])

    def _outside(self, t: Array, y: Array) -> tuple[Array, Array]:
        """Return by how many times its half y is from the envelope's middle, and its slope to y."""
        times, lower, upper = np.array(self.envelope).T
        low, high = np.interp(t, times, lower), np.interp(t, times, upper)
        half, off = (high - low) / 2, y - (high + low) / 2
        return np.abs(off) / half, np.sign(off) / half

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the measure at points alpha; infinite of a loop that is not stable, or not so.

        It is looked for at a few times, and closer at the points that are worst.
        """
        loops = self.loops(plant, law, alpha)
        values = np.array([self._value(loops, k, closely=False) for k in range(len(alpha))])
        worst = np.argsort(-values, kind="stable")[:CLOSEST]
        values[worst] = [self._value(loops, int(k)) for k in worst]
        return values

    def _value(self, loops: Loops, k: int, closely: bool = True) -> float:
        response = self.response(loops, k, closely)
        return self.measured(response) if len(response.t) else np.inf

    def measured(self, response: Response) -> float:
        """Return what is asked of a response, infinite where there is none."""
        size = abs(response.final)
        match self.measure:
            case "peak":
                return max(response.most(1.0), response.most(-1.0), size)
            case "settling":
                band = (self.band or 0.0) * (size if self.claimed.has_final else 1.0)
                return response.last(np.abs(response.y - response.final) - band)
            case _:  # of an envelope
                at = self.active(response)
                end = self._outside(np.array([np.inf]), np.array([response.final]))[0]
                return float(max(*self._outside(at, response.at(at))[0], *end))

    def begun(self, E: Array) -> Array:
        """Return x(0) (count, n): what E is where the motion is free, and zero in a step."""
        return np.asarray(0.0 * E[..., 0] if self.claimed.has_final else E.sum(axis=2))

    def response(self, loops: Loops, k: int, closely: bool = True) -> Response:
        """Return the response of one loop; without times of an unstable one.

        Parameters
        ----------
        closely : bool
            Whether peaks are looked for between times, of which there are many; else at a few.
        """
        return Response.of(loops, k, self.claimed.has_final, closely)

    def loops(self, plant: UncertainPlant, law: Any, alpha: Array) -> Loops:
        """Return the loops at points alpha."""
        closed = close(plant, law, alpha, disturbed=self.claimed.driven)
        channel = self.channel(delta_form(plant), alpha)
        return channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)


@dataclass(frozen=True)
class Near(Measured):
    """How near a signal is to where it tends to from a time on: one at the edge of the band."""

    time: float = field(default=0.0, kw_only=True)

    def active(self, response: Response) -> Array:
        """Return the time itself, and the times after it that count."""
        late = response.t > self.time
        over = np.where(late, np.abs(response.y - response.final), 0.0)
        return np.append(response.highest(over), self.time)

    def measures(self, t: Array, y: Array, final: Array) -> tuple[Array, Array, Array]:  # noqa: ARG002
        """Return it, and its slopes."""
        band = self.band or 0.0
        return np.abs(y - final) / band, np.sign(y - final) / band, np.zeros(len(y))

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return it at points alpha; infinite of a loop that is not stable."""
        loops = self.loops(plant, law, alpha)
        values = np.full(len(alpha), np.inf)
        stable = np.flatnonzero(np.all(loops.modes.poles.real < 0, axis=1))
        if len(stable):
            found = self.slopes(_some(loops, stable))
            values[stable] = 0.0
            np.maximum.at(values, stable[found.points], found.values)
        return values


def _some(loops: Loops, some: Any) -> Loops:
    modes = Modes(loops.A[some], loops.modes.step)
    return replace(loops, modes=modes, E=loops.E[some], C=loops.C[some], F=loops.F[some])


def _alone(measure: Any) -> str:
    """Say that an envelope is a measure of its own."""
    return (
        f"measure = {shown(measure)}: a measure of this name and an envelope go together; give "
        "envelope = [[TIME, LOWER, UPPER], ...] with no other measure"
    )


def _points(envelope: Any, name: str) -> Points:
    """Return an envelope's points.

    Raises
    ------
    InputError
        If it is none.
    """
    where = f"envelope of {name!r}"
    try:
        rows = [tuple(row) for row in envelope]
    except TypeError as error:
        raise InputError(
            f"{where} must be a list of points, [[TIME, LOWER, UPPER], ...]"
        ) from error
    for k, row in enumerate(rows, 1):
        if len(row) != 3 or not all(map(is_number, row)):
            raise InputError(f"{where}: point {k} must be three numbers, [TIME, LOWER, UPPER]")
        t, lower, upper = row
        if lower >= upper:
            raise InputError(
                f"{where}: point {k} is from {lower:g} to {upper:g}; the first is to be the lower"
            )
        if t < 0:
            raise InputError(f"{where}: point {k} is at {t:g} s; times begin at 0")
    for k, (one, other) in enumerate(pairwise(rows), 2):
        if one[0] >= other[0]:
            raise InputError(
                f"{where}: point {k} is at {other[0]:g} s, after {one[0]:g} s; times must rise"
            )
    if len(rows) > MAX_POINTS:
        raise InputError(f"{where} has {len(rows)} points; at most {MAX_POINTS} are supported")
    return tuple((float(t), float(lower), float(upper)) for t, lower, upper in rows)


class Piece(NamedTuple):
    """y from a time on, until the next piece begins: sum of weights e^(poles (t - begin))."""

    begin: float
    poles: Any
    weights: Any


@dataclass(frozen=True, eq=False)
class Response:
    """y of one loop at its times, and where it tends to: y = final + what its pieces are."""

    t: Array
    y: Array
    final: float
    pieces: tuple[Piece, ...]
    closely: bool

    @classmethod
    def none(cls, closely: bool) -> Response:
        """Return that of an unstable loop, without times."""
        return cls(np.zeros(0), np.zeros(0), np.nan, (), closely)

    @classmethod
    def of(cls, loops: Loops, k: int, final: bool, closely: bool = True) -> Response:
        """Return the response to all columns of E at once.

        Parameters
        ----------
        final : bool
            Whether E is of a constant disturbance; else it is where x begins.
        """
        A, E = loops.A[k], loops.E[k].sum(axis=1)
        C, F = loops.C[k][0], float(np.sum(loops.F[k]))
        poles, V = np.linalg.eig(A)
        if poles.real.max() >= 0:
            return cls.none(closely)
        t = times_of(poles) if closely else times_of(poles, FEW, TURN, TURNS)
        weights, end = (C @ V) * np.linalg.solve(V, E.astype(complex)), 0.0
        if final:
            weights = weights / poles
            end = float(F - weights.sum().real)
        return cls.in_pieces(t, end, (Piece(0.0, poles, weights),), closely)

    @classmethod
    def in_pieces(
        cls, t: Array, final: float, pieces: tuple[Piece, ...], closely: bool
    ) -> Response:
        """Return the response at times."""
        own = cls(t, t, final, pieces, closely)
        return replace(own, y=own.at(t))

    def at(self, t: Array) -> Array:
        """Return y at times."""
        t = np.asarray(t)
        number, y = self._pieces_of(t), np.empty(len(t))
        for k, (begin, poles, weights) in enumerate(self.pieces):
            now = number == k
            terms = np.exp(np.multiply.outer(t[now] - begin, poles)) * weights
            y[now] = terms.sum(axis=-1).real
        return np.asarray(y + self.final)

    def _pieces_of(self, t: Any) -> Any:
        begins = np.array([piece.begin for piece in self.pieces[1:]])
        return np.searchsorted(begins, t, side="right")

    def highest(self, size: Array) -> Array:
        """Return the times of the highest peaks of a number at all times, a few."""
        if not self.closely:
            return self.t[[int(size.argmax())]]
        return np.array([self._peak(k) for k in _tops(size)])

    def _peak(self, k: int) -> float:
        """Return the time near one of those at which y' is zero; that one at an end."""
        if not 0 < k < len(self.t) - 1:
            return float(self.t[k])
        t = float(self.t[k])
        begin, poles, weights = self.pieces[int(self._pieces_of(t))]
        for _ in range(CLOSER):
            terms = weights * poles * np.exp(poles * (t - begin))
            slope, bend = terms.sum().real, (poles * terms).sum().real
            moved = t - slope / bend if bend else t
            if not self.t[k - 1] < moved < self.t[k + 1]:
                break
            t = float(moved)
        return t

    def farthest(self, size: Callable[[Array], Array], ends: Array) -> Array:
        """Return the times from the first of some on at which a number is highest, a few."""
        t = np.union1d(self.t[self.t > ends[0]], ends)
        if not self.closely:
            return t[[int(size(t).argmax())]]
        found = list[float]()
        for k in _tops(size(t)):
            low, high = t[max(k - 1, 0)], t[min(k + 1, len(t) - 1)]
            best = float(t[k])
            for _ in range(CLOSER):
                near = np.union1d(np.linspace(low, high, FINER), best)
                i = int(size(near).argmax())
                best, low, high = float(near[i]), near[max(i - 1, 0)], near[min(i + 1, FINER - 1)]
            found.append(best)
        return np.array(found)

    def most(self, sign: float) -> float:
        """Return the largest of a sign times y."""
        return float((sign * self.at(self.highest(sign * self.y))).max())

    def last(self, over: Array) -> float:
        """Return the last time at which a number is above zero."""
        k = np.flatnonzero(over > 0)
        if not len(k):
            return 0.0
        return self._between(int(k[-1]), over) if k[-1] + 1 < len(over) else np.inf

    def first(self, over: Array) -> float:
        """Return the first time at which a number is not above zero."""
        k = np.flatnonzero(over <= 0)
        if not len(k):
            return np.inf
        return self._between(int(k[0]) - 1, over) if k[0] else 0.0

    def _between(self, k: int, over: Array) -> float:
        share = over[k] / (over[k] - over[k + 1])
        return float(self.t[k] + share * (self.t[k + 1] - self.t[k]))


def _tops(size: Array) -> list[int]:
    """Return the places of the highest peaks among numbers, a few, the highest first."""
    beside = np.pad(size, 1, constant_values=-np.inf)
    k = np.flatnonzero((size >= beside[:-2]) & (size >= beside[2:]))
    most = size[k].max()
    k = k[size[k] >= most - (1 - ALIKE) * abs(most)]
    return [int(i) for i in k[np.argsort(-size[k])][:MOST]]
