"""Crossing a bump: how large and how calm a signal is, from rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances, rows_at
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.bump import HEIGHT, RATE
from polefence.proof.text import exactly
from polefence.requirements.followed import times_of
from polefence.requirements.measured import FEW, TURN, TURNS, Measured, Near, Piece, Response
from polefence.requirements.slopes import Channel, Loops, Slopes, Turned
from polefence.requirements.specification import (
    Row,
    Specification,
    disturbance,
    is_number,
    number,
)
from polefence.response.discrete import exponential

UNITS = {"m/s": RATE, "m": HEIGHT}  # of a disturbance: what it is of the road
SIZES = {"height": "0.05  # m", "length": "2  # m", "speed": "10  # m/s"}
WAVES = 3  # what drives all of it: sine, cosine and one


@dataclass(frozen=True)
class BumpMeasure(Measured):
    """A measure of a signal while a bump is crossed, and after it, from rest.

    The road is ``height`` / 2 (1 - cos(2 pi x / ``length``)) over the bump and level elsewhere, as
    `polefence.vehicle.bump` has it. A disturbance in m/s is the rate of its height, one in m the
    height.

    Attributes
    ----------
    height, length, speed : float
        [m], [m] and [m/s].
    acts : str, optional
        "rate" or "height": what of the road all disturbances are, whatever their units.
    late : mapping of str to float
        By how much later a disturbance comes to the bump [s]: a wheelbase over the speed. Held as
        pairs of name and number.
    measure : str
        "peak", the largest absolute value; "settling", the time after which the signal stays within
        ``band`` of zero [s], the bump's own among it; "envelope", how many times as wide as it is
        an ``envelope`` must be.
    band : float, optional
        Of a settling time, in the signal's unit.
    envelope : sequence of (float, float, float), optional
        As `InitialMeasure` has it.
    disturbances : sequence of str, or mapping of str to float, optional
        Those that are the road, each so many times; all in m/s or m unless said. With ``acts`` all.
    """

    height: float = field(default=0.0, kw_only=True)
    length: float = field(default=0.0, kw_only=True)
    speed: float = field(default=0.0, kw_only=True)
    acts: str | None = field(default=None, kw_only=True)
    late: Any = field(default=(), kw_only=True)
    kind = "bump"
    keys: ClassVar[tuple[str, ...]] = (
        *("measure", "band", "envelope", "disturbances"),
        *("height", "length", "speed", "acts", "late"),
    )
    direct = True
    claimed = proof.BumpResponse

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        for key, example in SIZES.items():
            value = getattr(self, key)
            if not (is_number(value) and value > 0):
                raise InputError(f"{key} = {shown(value)} must be above zero: {key} = {example}")
            self._settle(key, float(value))
        if self.acts not in (None, RATE, HEIGHT):
            raise InputError(f'acts = {shown(self.acts)} must be "{RATE}" or "{HEIGHT}"')
        pairs = list(self.late.items()) if isinstance(self.late, Mapping) else self.late
        try:
            pairs = [(name, t) for name, t in pairs]
        except (TypeError, ValueError) as error:
            raise InputError(
                f'late = {shown(self.late)} must be a table of disturbances and times: {{"NAME" = '
                "0.25}"
            ) from error
        for name, t in pairs:
            if not (isinstance(name, str) and is_number(t) and t >= 0):
                raise InputError(f"late: {shown(name)} = {shown(t)} must be zero or more, in s")
        self._settle("late", tuple((name, float(t)) for name, t in pairs))

    @classmethod
    def _more(cls, row: Row) -> dict[str, Any]:
        for key, example in SIZES.items():
            if key not in row.table:
                raise InputError(f"{key} is missing; write {key} = {example}")
        own = {key: number(row.table[key], key) for key in SIZES}
        late = row.table.get("late", {})
        if isinstance(late, Mapping):
            late = {name: number(t, f"late.{name}") for name, t in late.items()}
        return own | {"late": late} | ({"acts": row.table["acts"]} if "acts" in row.table else {})

    @property
    def title(self) -> str:
        """Kind, signal, bump and measure, as a line has them."""
        sizes = "".join(f" with {key} {exactly(getattr(self, key))}" for key in SIZES)
        return f"{super().title}{sizes}{f' with acts {self.acts}' if self.acts else ''}"

    def in_units_of(self, other: Specification) -> BumpMeasure:
        """Return it with the times of another bump's disturbances, where it has none."""
        return self if self.late else replace(self, late=getattr(other, "late", ()))

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse disturbances that are no road, and a plant of which none is proved."""
        disturbance(plant)
        self._placed(plant)
        super().require_fit(plant)

    def scales(self, plant: UncertainPlant) -> tuple[float, ...]:
        """Return how many times each disturbance is the road."""
        if self.disturbances is not None:
            return super().scales(plant)
        chosen = tuple(
            float(physical and (self.acts is not None or w.unit in UNITS))
            for w, physical in zip(disturbances(plant), plant.physical, strict=True)
        )
        if any(chosen):
            return () if all(chosen) else chosen
        raise InputError(
            f"{self.title}: no disturbance of {plant.name} is in m/s or m, as a road is; write "
            f'acts = "{RATE}" where they are the rate of its height, "{HEIGHT}" where the height'
        )

    def _placed(self, plant: UncertainPlant) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """Return what each disturbance is of the road, and how late it is.

        Raises
        ------
        InputError
            If one that acts is in another unit, or there is none of a name.
        """
        known, late = disturbances(plant), dict(self.late)
        names, scales = [w.name for w in known], self.scales(plant) or (1.0,) * len(known)
        for name in late:
            if name not in names:
                raise InputError(f"late: no disturbance {name!r}; {suggest(name, names)}")
        for w, scale in zip(known, scales, strict=True):
            if scale and not self.acts and w.unit not in UNITS:
                raise InputError(
                    f"{self.title}: {w.name!r} is in {w.unit or 'no unit'}, and a road in m/s or "
                    f'm; write acts = "{RATE}" or "{HEIGHT}", or name the disturbances that are '
                    "the road"
                )
        acts = tuple(self.acts or UNITS.get(w.unit, RATE) for w in known)
        return acts, tuple(late.get(name, 0.0) for name in names)

    def _claimed(self, plant: UncertainPlant) -> dict[str, Any]:
        acts, late = self._placed(plant)
        sizes = {key: Fraction(repr(getattr(self, key))) for key in SIZES}
        times = tuple(Fraction(repr(t)) for t in late)
        return super()._claimed(plant) | sizes | {"acts": acts, "late": times}

    # --- values and slopes -----------------------------------------------------------------------

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.length / self.speed

    @property
    def begins(self) -> list[float]:
        """When disturbances come to the bump [s]: columns of E in turn, of rates and of heights."""
        return sorted({0.0, *(t for _, t in self.late)})

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the channel with columns of E for each time, of rates and of heights."""
        C, D, F = rows_at(plant, self.outputs(plant), alpha)
        (acts, late), begins = self._placed(plant), self.begins
        scales = self.scales(plant) or (1.0,) * len(acts)
        S = np.zeros((len(acts), 2 * len(begins)))
        for k, (scale, word, t) in enumerate(zip(scales, acts, late, strict=True)):
            S[k, 2 * begins.index(t) + (word == HEIGHT)] = scale
        return Channel(*plant.at(alpha), plant.driven(alpha) @ S, C, D, F @ S, S)

    def begun(self, E: Array) -> Array:
        """Return rest."""
        return np.asarray(0.0 * E[..., 0])

    @property
    def _pieces(self) -> list[tuple[float, Array]]:
        """When pieces begin, and what each column is of sine, cosine and one there (columns, 3).

        Angles are those of 2 pi t / duration.
        """
        ends = sorted({t + more for t in self.begins for more in (0.0, self.duration)})
        angle, found = 2 * math.pi / self.duration, list[tuple[float, Array]]()
        for begin in ends:
            R = np.zeros((2 * len(self.begins), WAVES))
            for k, t in enumerate(self.begins):
                if not t <= begin < t + self.duration:
                    continue
                sine, cosine = math.sin(angle * t), math.cos(angle * t)
                rate = math.pi * self.height / self.duration
                R[2 * k] = rate * cosine, -rate * sine, 0.0
                R[2 * k + 1] = self.height / 2 * np.array([-sine, -cosine, 1.0])
            found.append((begin, R))
        return found

    def response(self, loops: Loops, k: int, closely: bool = True) -> Response:
        """Return the response of one loop; without times of an unstable one."""
        A, E, C, F = loops.A[k], loops.E[k], loops.C[k][0], loops.F[k][0]
        poles, V = np.linalg.eig(A)
        if poles.real.max() >= 0:
            return Response.none(closely)
        turn = 2j * math.pi / self.duration
        waves = np.array([turn, -turn, 0.0])
        left, driven = C @ V, np.linalg.solve(V, E + 0j)
        pieces, x, last = list[Piece](), np.zeros(len(A), dtype=complex), 0.0
        forced = np.zeros((len(A), WAVES), dtype=complex)
        for begin, R in self._pieces:
            x = x * np.exp(poles * (begin - last)) + forced @ np.exp(waves * (begin - last))
            last = begin
            # sine and cosine as two turns, at this piece's begin
            turns = np.array([R @ [-0.5j, 0.5, 0], R @ [0.5j, 0.5, 0], R @ [0, 0, 1.0]])
            turns = turns * np.exp(waves * begin)[:, None]
            forced = (driven @ turns.T) / (waves - poles[:, None])
            x = x - forced.sum(axis=1)
            every = np.concatenate([left * x, left @ forced + turns @ F])
            pieces.append(Piece(begin, np.concatenate([poles, waves]), every))
        few = () if closely else (FEW, TURN, TURNS)
        end, after = pieces[-1].begin, times_of(poles, *few)
        during = np.linspace(0, end, 4 * len(after) // 3 if closely else FEW)
        t = np.union1d(np.union1d(during, after[after < end]), end + after)
        return Response.in_pieces(t, 0.0, tuple(pieces), closely)

    def slopes(self, loops: Loops) -> Slopes:
        """Return the measure at the times that count, with its slopes."""
        every = [self.active(self.response(loops, k)) for k in range(len(loops.A))]
        points = np.repeat(np.arange(len(every)), [len(times) for times in every])
        motions = [
            _Motion.of(loops, int(k), self._pieces, self.duration, float(t))
            for k, t in zip(points, np.concatenate(every), strict=True)
        ]
        t = np.array([motion.t for motion in motions])
        y = np.array([motion.y for motion in motions])
        values, of_y, _ = self.measures(t, y, np.zeros(len(y)))

        def turned() -> list[Turned]:
            found = zip(*(motion.slopes() for motion in motions), strict=True)
            A, C, E, F = (of_y[:, None, None] * np.array(M) for M in found)
            return [Turned(A, C, E, F)]

        return Slopes(values, points, turned)

    def near(self, **own: Any) -> BumpNearness:
        """Return how near the signal is from a time on."""
        return BumpNearness(**own)


@dataclass(frozen=True)
class BumpNearness(Near, BumpMeasure):
    """How near a signal is to zero from a time on: at most one where it is in the band."""


@dataclass(frozen=True, eq=False)
class _Motion:
    """x of one loop until a time, with what drives it behind: z' = M z in each piece."""

    loops: Loops
    k: int
    t: float
    spans: list[tuple[float, Array, Array]]  # how long, R and M
    z: list[Array]  # at the begin of each, and at the end

    @classmethod
    def of(
        cls, loops: Loops, k: int, pieces: list[tuple[float, Array]], duration: float, t: float
    ) -> _Motion:
        A, E = loops.A[k], loops.E[k]
        n, turn = len(A), 2 * math.pi / duration
        known = [piece for piece in pieces if piece[0] < t] or pieces[:1]
        ends = [*(begin for begin, _ in known[1:]), t]
        spans, z = list[tuple[float, Array, Array]](), [np.append(np.zeros(n), [0.0, 1.0, 1.0])]
        for (begin, R), end in zip(known, ends, strict=True):
            M = np.zeros((n + WAVES, n + WAVES))
            M[:n, :n], M[:n, n:] = A, E @ R
            M[n, n + 1], M[n + 1, n] = turn, -turn
            spans.append((end - begin, R, M))
            z.append(exponential(M[None] * (end - begin))[0] @ z[-1])
        return cls(loops, k, t, spans, z)

    @property
    def row(self) -> Array:
        """What y is of z at the end."""
        return np.append(self.loops.C[self.k][0], self.loops.F[self.k][0] @ self.spans[-1][1])

    @property
    def y(self) -> float:
        return float(self.row @ self.z[-1])

    def slopes(self) -> tuple[Array, Array, Array, Array]:
        """Return the slopes of y with respect to A, C, E and F."""
        n = self.loops.A.shape[1]
        size, row = n + WAVES, self.row
        dA, dE = np.zeros((n, n)), np.zeros(self.loops.E[self.k].shape)
        for (span, R, M), z in zip(self.spans[::-1], self.z[-2::-1], strict=True):
            both = np.zeros((2 * size, 2 * size))
            both[:size, :size] = both[size:, size:] = M.T
            both[:size, size:] = np.outer(row, z)
            moved = exponential(both[None] * span)[0]
            d = moved[:size, size:]
            dA, dE = dA + d[:n, :n], dE + d[:n, n:] @ R.T
            row = moved[:size, :size] @ row
        dF = self.spans[-1][1] @ self.z[-1][n:]
        return dA, self.z[-1][None, :n], dE, dF[None]
