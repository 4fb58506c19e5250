"""Sectors: static elements that no model has, for all of which the loop is to stay stable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import product
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.law.laws import Law, PolynomialGain, law_or_table
from polefence.plant.delta import delta_form
from polefence.plant.exact import matrices_of
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, disturbances, rows_at
from polefence.plant.points import seeded
from polefence.plant.system import Array, System
from polefence.proof import claims as proof
from polefence.proof import laws as exact
from polefence.proof.claims.sector import Elements
from polefence.proof.laws import Evidence
from polefence.proof.text import exactly
from polefence.proof.work import FormatError
from polefence.requirements import multipliers, scales
from polefence.requirements.disk_margin import FEW, Posed, flag_words, require_flag
from polefence.requirements.gain import SAMPLES, Gain
from polefence.requirements.margin import Margin, level_of
from polefence.requirements.slopes import Channel, Rated, Slopes, Turned
from polefence.requirements.slopes import Loops as ClosedLoops
from polefence.requirements.specification import (
    Row,
    Specification,
    disturbance,
    is_number,
    listed,
)
from polefence.requirements.weights import wider
from polefence.response.closed import close
from polefence.response.modes import Modes
from polefence.response.stationary import growth

# By what share a level may be higher of shorter multipliers; the others while parameters move.
SHORTER = (multipliers.SHORT, 0.03, 0.1, 0.3)
FLAGS = ("time_invariant", "slope_restricted")  # keys
FARTHEST = Fraction(1000)  # the largest factor at which numbers are tried
FACTORS, HALVINGS = 200, 40  # at which they are, and between two of them
MOST_CORNERS, INNER, SEED = 16, 12, 1  # directions of several
NEARER, MOST = 0.5, 30  # to zero, where the loop with the centres is not stable; how often at most


@dataclass(frozen=True)
class SectorBound(Margin):
    """How wide sectors of static elements may be: for all elements in them the loop is stable.

    An element gives a disturbance w = phi(t, y) for a signal y: a bump stop, friction, the curve of
    a valve. Whatever phi is, constant or not, the loop is globally exponentially stable while
    y phi is between a y^2 and b y^2. What is bounded is by what factor the sectors may be wider
    about their centres; a limit of one is for the sectors themselves.

    Attributes
    ----------
    signal : str or sequence of str
        y of each element.
    at_most : float, optional
        Of 1 over the factor; `least` takes the factor itself.
    disturbance : str or sequence of str
        w of each element, by its name.
    sector : pair of float, or sequence of pairs
        a and b of each.
    time_invariant : bool
        Of elements phi(y) alone, which do not depend on time: of these more is proved.
    slope_restricted : bool
        Of those alone whose slope, between any two points, is in the sector too: still more.
    weighed : Elements, optional
        With what it is proved, where that is known: else it is looked for.
    """

    disturbance: Any = field(default=(), kw_only=True)
    sector: Any = field(default=(), kw_only=True)
    time_invariant: bool = field(default=False, kw_only=True)
    slope_restricted: bool = field(default=False, kw_only=True)
    weighed: Elements | None = field(default=None, kw_only=True, compare=False)
    kind = "sector"
    keys = ("disturbance", "sector", "time_invariant", "slope_restricted")
    vector = True
    direct = True
    power = 1
    of_loops: ClassVar[bool] = False

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if self.disturbances is not None:
            raise InputError(f"a {self.kind} takes no disturbances; name one by disturbance")
        count, given = len(self.entries), self.disturbance
        named = (given,) if isinstance(given, str) else given
        good = isinstance(named, Sequence) and all(isinstance(w, str) for w in named)
        if not good or len(set(named)) != count or len(named) != count:
            raise InputError(
                f"disturbance = {shown(given)} must name one for each signal, each once; write "
                'disturbance = "NAME"'
            )
        self._settle("disturbance", tuple(named))
        self._settle("sector", _pairs(self.sector, count))
        for key in FLAGS:
            require_flag(getattr(self, key), self.kind, key)

    @classmethod
    def least(
        cls,
        signal: str | Sequence[str],
        disturbance: str | Sequence[str],
        sector: Any,
        at_least: float | None = 1.0,
        *,
        time_invariant: bool = False,
        slope_restricted: bool = False,
    ) -> Self:
        """Return the requirement that the sectors may be so many times as wide.

        One by default, the sectors themselves; None: as many times as can be.
        """
        own: dict[str, Any] = {"disturbance": disturbance, "sector": sector}
        own |= {"time_invariant": time_invariant, "slope_restricted": slope_restricted}
        return cls(signal, level_of(at_least), **own)

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        table = row.table
        for key, written in (("disturbance", '"NAME"'), ("sector", "[0, 20000]")):
            if key not in table:
                raise InputError(f"{key} is missing; write {key} = {written}")
        own = {key: table[key] for key in cls.keys if key in table}
        return cls(table["signal"], **row.given(), **own)

    @property
    def title(self) -> str:
        """Kind, signals, disturbances and sectors, as a line has them."""
        ends = ", ".join(exactly(end) for pair in self.sector for end in pair)
        named = listed(self.disturbance)
        whole = f"{super().title} with disturbance {named} with sector [{ends}]"
        return whole + "".join(flag_words(getattr(self, key), key) for key in FLAGS)

    @property
    def stays(self) -> bool:
        """Whether elements do not depend on time."""
        return self.time_invariant or self.slope_restricted

    # --- what it is of ----------------------------------------------------------------------------

    def scales(self, plant: UncertainPlant) -> tuple[float, ...]:
        """Return one for the disturbances of elements, zero for others."""
        chosen = self._numbers(plant)
        return tuple(float(k in chosen) for k in range(plant.disturbance_count))

    def _numbers(self, plant: UncertainPlant) -> tuple[int, ...]:
        names = [w.name for w in disturbances(plant)]
        for name in self.disturbance:
            if name not in names:
                raise InputError(f"{self.title}: no disturbance {name!r}; {suggest(name, names)}")
        return tuple(map(names.index, self.disturbance))

    def require_samples(self, plant: UncertainPlant, F: Array | None) -> None:
        """Nothing: no disturbance is held."""

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without the elements, or of which nothing of the kind is proved."""
        disturbance(plant)
        self.require_late(plant)
        if plant.sampling is not None:
            raise InputError(
                f"{self.title}: an element acts between samples too; leave out the sample time"
            )
        try:
            elements = self.elements(plant)
            A, B, E = matrices_of(plant)
            elements.fed_back((A, B), elements.of(E))
            elements.remainder(plant.remainder, *plant.shape)
        except FormatError as error:
            raise InputError(f"{self.title}: {error}") from error

    def readable(self, plant: UncertainPlant, known: tuple[str, ...]) -> tuple[str, ...]:
        """Return all but what the elements pass into, where a law would pass that on to them."""
        if not any(np.any(y.arrays(plant)[1]) for y in self.signals(plant)):
            return known
        chosen = list(self._numbers(plant))
        return tuple(
            name for name in known if not np.any(plant.signal(name).arrays(plant)[2][:, chosen])
        )

    def elements(self, plant: UncertainPlant) -> Elements:
        """Return the elements exactly, weighed alike.

        Raises
        ------
        InputError, FormatError
            If the plant has none that are known so.
        """
        signals = []
        for y in self.signals(plant):
            C, D, F = ([[list(row)] for row in rows] for rows in y.exact(plant))
            driven = tuple(F) if any(any(row) for (row,) in F) else ()
            signals.append(proof.Output(C, D, y.name, driven, near=y.near))
        sectors = tuple((_decimal(a), _decimal(b)) for a, b in self.sector)
        weights = (Fraction(1),) * len(signals)
        elements = Elements(tuple(signals), self._numbers(plant), sectors, weights)
        elements.require(*plant.shape, plant.disturbance_count)
        return elements

    def posed(self, plant: UncertainPlant, law: Any) -> Posed:
        """Return the plant with the centres fed back, the law beside it, and the gain.

        Of elements with multipliers it is posed for a level: that of the limit, or about the least.
        """
        changed, beside, elements = self._centred(plant, law)
        level, elements = self._weigh(changed, beside, elements)
        if not (elements.multipliers or elements.lags):
            return changed, beside, _gain(self, changed, elements)
        asked = replace(self, at_most=self.at_most or level or 1.0)
        return _with_multipliers(asked, changed, beside, elements)

    def _weigh(
        self, changed: UncertainPlant, law: Any, elements: Elements
    ) -> tuple[float | None, Elements]:
        """Return with what it is proved, and about the level where that has multipliers."""
        if self.weighed is not None:
            return None, self.weighed
        for found in self._multiplied(changed, law, elements):
            if not found.multipliers.alone:
                return found.level, _with(elements, found.multipliers)
        return None, replace(elements, weights=_weights(changed, law, elements))

    def ways(
        self, plant: UncertainPlant, law: Any
    ) -> tuple[tuple[float | None, Specification], ...]:
        """Return it with multipliers, of about the least level that is proved; and without."""
        changed, beside, elements = self._centred(plant, law)
        shares = SHORTER if changed.moving else SHORTER[:1]
        several = self._multiplied(changed, beside, elements, shares)
        if any(np.any(found.multipliers.h) for found in several):
            several += self._multiplied(changed, beside, elements, lags=False)
        ways = list[tuple[float | None, Specification]]()
        for found in several:
            if not found.multipliers.alone:
                own = _with(elements, found.multipliers)
                ways.append((found.level, replace(self, weighed=own)))
        bare = replace(elements, weights=_weights(changed, beside, elements))
        return (*ways, (None, replace(self, weighed=bare)))

    def _centred(self, plant: UncertainPlant, law: Any) -> tuple[UncertainPlant, Any, Elements]:
        """Return the plant with the centres fed back, the law beside it, and the elements."""
        try:
            elements = self.elements(plant)
            return (*_with_centres(plant, law, elements), elements)
        except FormatError as error:
            raise InputError(f"{self.title}: {error}") from error

    def _rated(self, changed: UncertainPlant, law: Any, elements: Elements) -> Rated:
        """Return which elements of a plant with their centres fed back may have multipliers."""
        count = elements.count
        none = Rated((False,) * count, (False,) * count)
        if not self.stays:
            return none
        subject = _subject(changed, law)
        led = tuple(_may_have(elements, k, subject, "multipliers") for k in range(count))
        lagged = (_may_have(elements, k, subject, "lags") for k in range(count))
        return Rated(led, tuple(lagged) if self.slope_restricted else none.lagged)

    def _multiplied(
        self,
        changed: UncertainPlant,
        law: Any,
        elements: Elements,
        shares: Sequence[float] = SHORTER[:1],
        *,
        lags: bool = True,
    ) -> tuple[multipliers.Found, ...]:
        """Return multipliers for a few points; none where no element may have one."""
        rated = self._rated(changed, law, elements)
        rated = rated if lags else rated._replace(lagged=())
        if not rated.any:
            return ()
        few = seeded(changed, len(changed.vertices) + FEW)
        loops = _loops(changed, law, elements, few)
        return multipliers.found(loops, *rated, longer=bool(changed.moving), shares=shares)

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about elements that weigh alike."""
        elements = self.elements(plant)
        E = elements.of(subject.E)
        A, B = elements.fed_back((subject.A, subject.B), E)
        rest = elements.remainder(subject.remainder, subject.n, subject.m)
        law = elements.law(subject.law)
        changed = replace(subject, A=A, B=B, E=E, law=law, remainder=rest, nodes=())
        return proof.SectorBound.of(changed, elements, level, **self.claimed)

    @property
    def claimed(self) -> dict[str, bool]:
        """What a claim says of curves."""
        return {"invariant": self.stays, "restricted": self.slope_restricted}

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has its centres."""
        return f"{self.title}: no LMI has it; leave out the method, so that a law is tuned"

    @property
    def surely(self) -> SectorBound:
        """The limit of elements that are numbers: what exceeds it refutes this one."""
        own: dict[str, Any] = {key: getattr(self, key) for key in self.keys}
        return LinearElements(self.signal, self.at_most, **own)

    def linear(self, plant: UncertainPlant, law: Any, alpha: Array) -> tuple[Array, Array]:
        """Return the least factors for which numbers in the sectors make loops unstable.

        In floats, at points alpha: (count,), infinite where none were found, and the signs
        (count, elements) of the numbers less the centres.
        """
        closed = close(plant, law, alpha)
        channel = self.channel(delta_form(plant), alpha)
        loops = channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)
        centres = np.array([(a + b) / (b - a) for a, b in self.sector])  # of radii of one
        corners = np.array(list(product((1.0, -1.0), repeat=len(centres))))[:MOST_CORNERS]
        signs = np.concatenate([corners, _inner(len(centres))])
        least = np.full((len(alpha), len(signs)), np.inf)
        for j, sign in enumerate(signs):
            least[:, j] = _first(loops, centres, sign, closed.step)
        best = least.argmin(axis=1)
        return least[np.arange(len(alpha)), best], signs[best]

    # --- what samples show, and slopes ------------------------------------------------------------

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return 1 over the factor at points alpha; infinite where the centres are not stable."""
        law = law_or_table(plant, law.as_law() if hasattr(law, "as_law") else law)
        changed, beside, elements = self._centred(plant, law)
        several = self._multiplied(changed, beside, elements)
        closed, values = close(changed, beside, alpha), np.full(len(alpha), np.inf)
        stable = np.all(growth(closed.poles(), closed.step) < 0, axis=1)
        if stable.any() and several:
            loops = _loops(changed, beside, elements, alpha[stable])
            values[stable] = multipliers.values(loops, several[0].multipliers)
        elif stable.any():
            changed, beside, gain = self.posed(plant, law)
            values[stable] = gain.values(changed, beside, alpha[stable])
        return values

    @property
    def coupled(self) -> bool:
        """Sectors are made as small as one point wants it."""
        return True

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the signals, times their radii, and the elements as a channel at points alpha.

        The centres are fed back in the closed loop, see `slopes`.
        """
        disturbance(plant)
        chosen = list(self._numbers(plant))
        E = plant.driven(alpha)[..., chosen]
        C, D, _ = rows_at(plant, self.signals(plant), alpha)
        radii = np.array([(b - a) / 2 for a, b in self.sector])[:, None]
        S = np.eye(plant.disturbance_count)[:, chosen]
        F = np.zeros((len(alpha), len(chosen), len(chosen)))
        rated = self._rated(*self._centred(plant, None))
        return Channel(*plant.at(alpha), E, radii * C, radii * D, F, S, rated=rated)

    def slopes(self, loops: ClosedLoops) -> Slopes:
        """Return peaks of the largest singular value with their slopes, elements weighed anew.

        Where the loop with the centres is not stable, sectors nearer to zero are looked at, which
        are so many times as small.
        """
        centres = np.array([(a + b) / (b - a) for a, b in self.sector])  # of radii of one
        share = 1.0
        for _ in range(MOST):
            fed = _Fed.back(loops, share * centres)
            if np.all(growth(fed.loops.modes.poles, loops.modes.step) < 0):
                break
            share *= NEARER
        rated = _unmoved(fed.loops)
        if rated.any:
            found = multipliers.slopes(fed.loops, *rated)
        elif len(centres) > 1:
            found = scales.slopes(fed.loops, 0, 1.0)
        else:
            found = Gain("z").slopes(fed.loops)
        values = found.values
        if share < 1:  # more than any limit
            values = (max(1.0, self.at_most or 1.0) + values) / share

        def turned() -> list[Turned]:
            (own,) = found.turned()
            E = None if own.E is None else own.E / share
            return [fed.turned(Turned(own.A / share, own.C / share, E), found.points)]

        return replace(found, values=values, turned=turned)


class _Fed(NamedTuple):
    """Loops x' = A x + E w, y = C x with w = c y + z: x' = (A + E c C) x + E z."""

    loops: ClosedLoops
    bare: ClosedLoops
    c: Array

    @classmethod
    def back(cls, loops: ClosedLoops, c: Array) -> _Fed:
        """Return loops with numbers c (count of y,) fed back."""
        A = loops.A + (loops.E * c) @ loops.C
        return cls(replace(loops, modes=Modes(A, loops.modes.step)), loops, c)

    def turned(self, own: Turned, points: Any) -> Turned:
        """Return slopes with respect to the bare loops from those with respect to these."""
        E, C = self.bare.E[points] * self.c, self.bare.C[points] * self.c[:, None]
        of_C = own.C + np.swapaxes(E, 1, 2) @ own.A
        of_E = own.A @ np.swapaxes(C, 1, 2) + (0.0 if own.E is None else own.E)
        return Turned(own.A, of_C, of_E)


@dataclass(frozen=True)
class LinearElements(SectorBound):
    """How wide sectors of numbers may be: less than this is proved of no elements."""

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return 1 over the factor at points alpha, in floats."""
        law = law_or_table(plant, law.as_law() if hasattr(law, "as_law") else law)
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.linear(plant, law, alpha)[0])


def _inner(count: int) -> Array:
    """Return directions of several numbers that are no corners."""
    if count == 1:
        return np.zeros((0, 1))
    random = np.random.default_rng(SEED)
    return np.round(random.uniform(-1, 1, (INNER, count)), 3)


def _first(loops: ClosedLoops, centres: Array, sign: Array, step: float) -> Array:
    """Return the factor at which numbers first make each loop unstable, along one direction."""

    def unstable(factors: Array) -> Array:
        k = centres + factors[..., None] * sign
        A = loops.A[:, None] + (loops.E[:, None] * k[..., None, :]) @ loops.C[:, None]
        return np.asarray(np.any(growth(np.linalg.eigvals(A), step) >= 0, axis=-1))

    grid = np.concatenate([[0.0], np.geomspace(1e-3, float(FARTHEST), FACTORS)])
    gone = unstable(np.broadcast_to(grid, (len(loops.A), len(grid))))
    k = gone.argmax(axis=1)
    low, high = grid[np.maximum(k - 1, 0)], grid[k]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        beyond = unstable(middle[:, None])[:, 0]
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.where(gone.any(axis=1), high, np.inf)


@dataclass(frozen=True)
class ElementsGain(Gain):
    """The gain of a loop with the centres fed back, whose claim is that of its elements."""

    elements: Elements = field(default_factory=lambda: Elements((), (), (), ()))
    bare: proof.Subject | None = None  # the loop without multipliers, of exactly this law
    claimed: Any = field(default_factory=dict)
    asked: str = ""

    @property
    def title(self) -> str:
        """That of the requirement."""
        return self.asked

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,  # noqa: ARG002
    ) -> proof.BoundClaim:
        """Return the claim about the elements: of the loop without multipliers."""
        if self.bare is not None:
            own = {key: getattr(self.bare, key) for key in ("A", "B", "E", "law", "remainder")}
            subject = replace(subject, **own)
        return proof.SectorBound.of(subject, self.elements, level, **self.claimed)


def _pairs(given: Any, count: int) -> tuple[tuple[float, float], ...]:
    """Return the ends of each sector: of a pair, of pairs, or of numbers in a row."""
    flat = list[Any]()
    for item in given if isinstance(given, Sequence) and not isinstance(given, str) else ():
        nested = isinstance(item, Sequence) and not isinstance(item, str)
        flat += item if nested else [item]
    numbers = [float(x) if isinstance(x, Fraction) else x for x in flat]
    pairs = tuple(zip(numbers[::2], numbers[1::2], strict=False))
    good = len(numbers) == 2 * count and all(map(is_number, numbers))
    if not good or not all(a < b for a, b in pairs):
        many = "" if count == 1 else ", for each signal one: [[0, 20000], [-1, 1]]"
        raise InputError(
            f"sector = {shown(given)} must be two numbers, the smaller first; write sector = "
            f"[0, 20000]{many}"
        )
    return tuple((float(a), float(b)) for a, b in pairs)


def _decimal(value: float) -> Fraction:
    return Fraction(repr(value))


def _with_centres(
    plant: UncertainPlant, law: Any, elements: Elements
) -> tuple[UncertainPlant, Any]:
    """Return the plant with the centres fed back, on which elements alone act, and the law."""
    A, B, E = matrices_of(plant)
    E = elements.of(E)
    A, B = elements.fed_back((A, B), E)
    n, m = plant.shape
    beside = law
    if isinstance(law, PolynomialGain) and law.passes:
        beside = _reading(law, elements.law(_rows_read(plant, law)), elements.count)
    named: dict[str, Any] = {
        "disturbances": tuple(f"element {k + 1}" for k in range(elements.count)),
        "states": tuple(f"state {i + 1}" for i in range(n)),
        "noise": (),
        "vehicle": None,
        "remainder": elements.remainder(plant.remainder, n, m),
    }
    return _of_matrices(plant, beside, (A, B, E), **named), beside


def _of_matrices(
    plant: UncertainPlant, law: Any, matrices: tuple[Any, Any, Any], **changes: Any
) -> UncertainPlant:
    """Return a plant with other matrices, whose outputs are what a law beside it reads."""
    vertices = list[System]()
    for j, vertex in enumerate(plant.vertices):
        A, B, E = (tuple(map(tuple, M[j])) for M in matrices)
        vertices.append(System(A, B, E, vertex.name))
    outputs = law.measured if isinstance(law, PolynomialGain) else ()
    return replace(plant, vertices=tuple(vertices), outputs=outputs, **changes)


def _rows_read(plant: UncertainPlant, law: Any) -> exact.Law:
    """Return the rows of what a law reads, where disturbances pass into it."""
    if not isinstance(law, PolynomialGain) or not law.passes:
        return exact.Law()
    known = [y.exact(plant) for y in law.measured]
    count = len(plant.vertices)
    C, F = (tuple([list(y[k][j]) for y in known] for j in range(count)) for k in (0, 2))
    return exact.Law(C=C, F=F)


def _reading(law: PolynomialGain, read: exact.Law, count: int) -> PolynomialGain:
    """Return a law of other rows of so many elements."""
    none = [[Fraction(0)] * count] * len(law.measured)
    return replace(
        law,
        measured=tuple(
            Output(
                y.name,
                y.unit,
                C=[M[j] for M in read.C],
                F=[M[j] for M in read.F or (none,) * len(read.C)],
            )
            for j, y in enumerate(law.measured)
        ),
    )


# --- multipliers: of a plant with the centres fed back, and the law beside it --------------------


def _subject(plant: UncertainPlant, law: Any) -> proof.Subject:
    """Return the loop exactly, with the rows of a law into which elements pass."""
    A, B, E = matrices_of(plant)
    read, rest = _rows_read(plant, law), plant.remainder
    return proof.Subject(A, B, E, read, Evidence([]), step=plant.period, remainder=rest)


def _may_have(elements: Elements, k: int, subject: proof.Subject, key: str) -> bool:
    """Whether an element may have a multiplier, or a lag."""
    one = Fraction(1) if key == "multipliers" else (Fraction(1), Fraction(1))
    none = Fraction(0) if key == "multipliers" else (Fraction(0), Fraction(0))
    own: dict[str, Any] = {key: tuple(one if j == k else none for j in range(elements.count))}
    try:
        replace(elements, **own).require_multipliers(subject)
    except FormatError:
        return False
    return True


def _unmoved(loops: ClosedLoops) -> Rated:
    """Return which may have multipliers: those of rates that no element enters, and lags."""
    rated = loops.rated
    if rated is None or not any(rated.led):
        return rated or Rated((), ())
    moved = np.abs(loops.C @ loops.E).max(axis=2)
    size = np.linalg.norm(loops.C, axis=2) * np.linalg.norm(loops.E, axis=(1, 2))[:, None]
    still = np.all(moved <= 1e-12 * size, axis=0)
    led = tuple(bool(a and b) for a, b in zip(rated.led, still, strict=True))
    return rated._replace(led=led)


def _with(elements: Elements, found: multipliers.Multipliers) -> Elements:
    """Return the elements with multipliers."""
    weights, times = found.exact
    led = tuple(t * r for t, r in zip(times, elements.radii, strict=True))
    lags = found.lags
    return replace(
        elements,
        weights=weights,
        multipliers=led if any(led) else (),
        lags=lags if any(b for _, b in lags) else (),
    )


def _with_multipliers(
    asked: SectorBound, changed: UncertainPlant, law: Any, elements: Elements
) -> Posed:
    """Return the plant and the law with p y' and l fed back, and the gain at the level asked."""
    level, subject = Fraction(asked.at_most or 1.0), _subject(changed, law)
    led = elements.with_lags(level, elements.with_rates(subject))
    more = [f"lag {k + 1}" for k in elements.lagging]
    known = {"remainder": led.remainder, "states": (*changed.states, *more)}
    wide = _of_matrices(changed, None, (led.A, led.B, led.E), **known)
    beside = wider(law, changed, wide)
    if led.law.F:
        beside = _reading(beside, led.law, elements.count)
    if isinstance(beside, PolynomialGain):
        wide = replace(wide, outputs=beside.measured)
    rated = elements.rated(level, subject)
    bare = replace(subject, law=law.exact) if isinstance(law, Law) else None
    return wide, beside, replace(_gain(asked, wide, elements, rated), bare=bare)


def _loops(changed: UncertainPlant, law: Any, elements: Elements, alpha: Array) -> ClosedLoops:
    """Return loops at points alpha, from z to r y of elements that weigh alike."""
    closed = close(changed, law, alpha)
    channel = Gain.channel(_gain(None, changed, elements.alike), delta_form(changed), alpha)
    return channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)


def _gain(
    asked: SectorBound | None,
    changed: UncertainPlant,
    elements: Elements,
    rated: tuple[proof.Output, ...] = (),
) -> ElementsGain:
    """Return the gain from the elements to their signals, or to what multipliers make of these."""
    outputs = [
        Output(f"signal {k + 1}", C=[M[0] for M in y.C], D=[M[0] for M in y.D])
        for k, y in enumerate(rated or elements.outputs())
    ]
    scales = dict(zip(changed.disturbances, map(float, elements.scales), strict=True))
    return ElementsGain(
        outputs if len(outputs) > 1 else outputs[0],
        None if asked is None else asked.at_most,
        at=SAMPLES,
        disturbances=None if set(scales.values()) == {1.0} else scales,
        elements=elements,
        claimed={} if asked is None else asked.claimed,
        asked="" if asked is None else asked.title,
    )


def _weights(changed: UncertainPlant, law: Any, elements: Elements) -> tuple[Fraction, ...]:
    """Return weights of elements for which the gain is about least at a few points."""
    if elements.count == 1:
        return elements.weights
    loops = _loops(changed, law, elements, seeded(changed, len(changed.vertices) + FEW))
    if not np.all(growth(loops.modes.poles, loops.modes.step) < 0):
        return elements.weights
    return scales.scaled(loops, 0, 1.0).scale.exact[0]
