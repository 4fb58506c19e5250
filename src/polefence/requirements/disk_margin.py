"""Disk margins: how far gain and phase of loops may be off, all at once, before one is unstable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, partial
from typing import Any, ClassVar, Self, cast

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.law.laws import FixedGain, Law, PolynomialGain, law_or_table
from polefence.lmi.conditions import performance as conditions
from polefence.plant.delta import delta_form
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import DEMAND, FILTER, INTEGRAL, as_read
from polefence.plant.outputs import Output, disturbances, inputs, states
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array, System
from polefence.plant.weights import shape_of
from polefence.proof import claims as proof
from polefence.proof import laws as proof_laws
from polefence.proof.claims.disk_margin import Loops, Path, beside_loops, through
from polefence.proof.filters import Filter, Filters, in_turn
from polefence.proof.remainder import Rows
from polefence.proof.text import exactly
from polefence.requirements import scales
from polefence.requirements.gain import SAMPLES, Gain
from polefence.requirements.margin import Margin, level_of
from polefence.requirements.slopes import Acting, Channel, Slopes
from polefence.requirements.slopes import Loops as ClosedLoops
from polefence.requirements.specification import BestScale, Row, Specification, is_number
from polefence.requirements.weights import Shape, behind
from polefence.response.closed import close
from polefence.response.loop_margins import LoopMargins, margins
from polefence.response.modes import Modes
from polefence.response.opened import opened
from polefence.response.stationary import growth

Posed = tuple[UncertainPlant, Law, Specification]

FLAG = "time_invariant"  # a key
TO = " -> "  # in the name of a path
FEW = 20  # samples beside the vertices for which loops are weighed, as many as for a bound
MOST_SCALES, SAME = 30, 1e-6  # of samples; what is no other value


@dataclass(frozen=True)
class DiskMargin(Margin):
    """The disk margin of a loop, or of several at once.

    At each loop the signal may be multiplied by any f = (1 + (1 - sigma) d / 2) /
    (1 - (1 + sigma) d / 2) with |d| below the margin, alike or not, constant or not, and the closed
    loop stays stable: a gain of (2 + a) / (2 - a) for a balanced margin a (sigma = 0), and a phase
    of 2 atan(a / 2). With sigma 1 it is that of the sensitivity, with -1 that of its complement.

    Attributes
    ----------
    signal : str or sequence of str
        The loops: inputs, and signals that the law measures, by their names.
    at_most : float, optional
        Of 1 over the margin; `at_least` of a limit is in its place.
    sigma : float
        The skew of the disk.
    time_invariant : bool
        Of factors that do not vary in time alone: of several loops more is proved of these.
    """

    sigma: float = 0.0
    time_invariant: bool = field(default=False, kw_only=True)
    kind = "disk margin"
    keys = ("sigma", "time_invariant")
    vector = True
    direct = True
    power = 1
    late_as = proof.DiskMargin.late_as
    of_dynamics: ClassVar[bool] = False  # whether dynamics are added, and no factor acts
    by_gain: ClassVar[bool] = True  # whether the gain in which it is posed is the margin itself
    shapes: ClassVar[tuple[Shape, ...]] = ()
    claimed: ClassVar[type[proof.DiskMargin]] = proof.DiskMargin

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if self.disturbances is not None:
            raise InputError(f"a {self.kind} takes no disturbances; leave them out")
        if not is_number(self.sigma) or abs(self.sigma) > 100:
            raise InputError(f"sigma = {self.sigma!r} of a {self.kind} must be from -100 to 100")
        require_flag(self.time_invariant, self.kind)

    @classmethod
    def least(
        cls,
        loops: str | Sequence[str],
        at_least: float | None = None,
        sigma: float = 0.0,
        *,
        time_invariant: bool = False,
    ) -> Self:
        """Return the requirement that a margin is at least so large; None: as large as can be."""
        return cls(loops, level_of(at_least), sigma, time_invariant=time_invariant)

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        given = row.given(*(key for key in cls.keys if key in row.table and key != FLAG))
        flag = {FLAG: row.table[FLAG]} if FLAG in row.table else {}
        return cls(row.table["signal"], **given, **flag)

    @property
    def title(self) -> str:
        """Kind, loops and skew, as a line has them."""
        skew = f" with sigma {exactly(self.sigma)}" if self.sigma else ""
        return f"{super().title}{skew}{flag_words(self.time_invariant)}"

    def scales(self, plant: UncertainPlant) -> tuple[float, ...]:  # noqa: ARG002
        """Return nothing: no disturbance of the plant acts."""
        return ()

    def passed(self, plant: UncertainPlant, F: Array) -> Array:  # noqa: ARG002
        """Return zero: no disturbance of the plant acts."""
        return np.zeros_like(F)

    def require_samples(self, plant: UncertainPlant, F: Array | None) -> None:
        """Nothing: no disturbance of the plant acts."""

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without a loop of that name."""
        for name in self.names:
            if place_of(plant, name, None)[0] == "path" and not self.of_dynamics:
                raise InputError(f"{self.title}: {name!r} is a path; ask for unmodelled dynamics")
        self.require_late(plant)
        limit, straight = self.limit, any(y.D or y.F for y in plant.every_output)
        least = abs(1 + self.sigma) / 2  # of |S + (sigma - 1) / 2| where nothing comes back
        if limit is not None and limit * least > 1 and not straight:
            raise InputError(
                f"{self.title} >= {exactly(limit)}: no loop has more than {exactly(1 / least)}, "
                "for at high frequencies nothing comes back; ask for less"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """The loops' names."""
        return tuple(entry if isinstance(entry, str) else entry.name for entry in self.entries)

    def signals(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return the loops' signals."""
        return tuple(_signal(plant, name) for name in self.names)

    def posed(self, plant: UncertainPlant, law: Any) -> Posed:
        """Return the plant with its loops opened, the law beside it, and the gain to be bounded.

        Raises
        ------
        InputError
            If the law measures no signal of that name.
        """
        opened, beside, gain = self._alike(plant, law)
        if gain.loops.count == 1:
            return opened, beside, gain
        few = seeded(plant, len(plant.vertices) + FEW)
        weights, leads = _scale(opened, beside, gain, few)
        loops = replace(gain.loops, weights=weights, leads=leads)
        return opened, beside, _gain(self, opened, loops, beside)

    def _alike(self, plant: UncertainPlant, law: Any) -> tuple[UncertainPlant, Any, LoopGain]:
        """Return the same of loops that weigh alike."""
        loops = self.loops_of(plant, law)
        self._require_cut(plant, law, loops)
        beside = reading_beside(plant, law, loops)
        opened = open_loops(plant, loops, beside)
        return opened, beside, _gain(self, opened, loops, beside)

    @property
    def coupled(self) -> bool:
        """Whether several loops are weighed, alike for all points."""
        return len(self.names) > 1

    def scales_apart(self, plant: UncertainPlant, law: Any) -> bool:
        """Whether there are several loops, and parameters that do not move."""
        return len(self.names) > 1 and may_part(plant, law)

    def best_scales(self, plant: UncertainPlant, law: Any, alpha: Array) -> Iterator[BestScale]:
        """Return the best scale of the loops at each point, and the level it leads to."""
        loops = closed_loops(*self._alike(plant, law), alpha)
        return scales.of_each(loops, 0, 1.0, leads=self.time_invariant)

    def _require_cut(self, plant: UncertainPlant, law: Any, loops: Loops) -> None:
        """Refuse a loop that is not the one that its name says.

        What a law remembers of its own demands does not change with the actuator, and a PID has
        its integral and its filter of a signal too.
        """
        late = _on_the_way(plant)
        if loops.inputs and late:
            K = np.asarray(law.gain(np.eye(len(plant.vertices))))
            if np.any(K[..., late]):
                raise InputError(
                    f"{self.title}: the law feeds back its own demands that are on their way, "
                    "which no actuator changes; measure other signals alone, by measured"
                )
        names = [state.name for state in states(plant)]
        for name in self.names:
            parts = f"{INTEGRAL}{name}", f"{FILTER}{name}"
            if loops.measured and any(part in names for part in parts):
                raise InputError(
                    f"{self.title}: a PID reads {name!r} by its integral and its filter too; open "
                    "the loop at the input"
                )

    def loops_of(self, plant: UncertainPlant, law: Any) -> Loops:
        """Return where a plant and a law, of either kind, have their loops opened."""
        places = [place_of(plant, name, law) for name in self.names]
        inputs, measured = (
            tuple(k for kind, k in places if kind == key) for key in ("input", "measured")
        )
        weights, paths = (Fraction(1),) * len(places), paths_of(plant, self.names)
        straight = through(file_plant(plant), _read(plant, law))
        skew = Fraction(repr(float(self.sigma)))
        return Loops(inputs, measured, skew, weights, straight, paths=paths)

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about the margin, of loops that weigh alike."""
        loops = self.loops_of(plant, subject.law)
        opened = opened_subject(subject, plant, loops)
        invariant = self.time_invariant
        shapes = self.shapes_at(plant)
        return _claimed(self.claimed, opened, loops, level, shapes, invariant=invariant)

    def shapes_at(self, plant: UncertainPlant) -> tuple[Shape, ...]:
        """Return the weights as claims about a plant have them."""
        return tuple(Shape(shape.at(plant.period)) for shape in self.shapes)

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,
        unit: float | None = None,
        law: Law | None = None,
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return the gain as an LMI has it; of loops at inputs alone."""
        if why := self.beyond_lmi(plant):
            raise InputError(why)
        loops = self.loops_of(plant, law)
        opened = open_loops(plant, loops)
        gain = replace(_gain(self, opened, loops), at_most=self.at_most)
        return gain.condition(opened, domain, unit, law)

    def readable(self, plant: UncertainPlant, known: tuple[str, ...]) -> tuple[str, ...]:
        """Return all but the demands on their way, which no actuator changes."""
        if all(place_of(plant, name, None)[0] != "input" for name in self.names):
            return known
        late = {states(plant)[k].name for k in _on_the_way(plant)}
        return tuple(name for name in known if name not in late)

    def beyond_lmi(self, plant: UncertainPlant) -> str:
        """Say that loops at measured signals depend on the law."""
        if all(place_of(plant, name, None)[0] == "input" for name in self.names):
            return ""
        return (
            f"{self.title}: an LMI takes loops at inputs alone; leave out the method, so that a "
            "law is tuned"
        )

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return 1 over the margin at points alpha."""
        law = law.as_law() if hasattr(law, "as_law") else law
        law = law_or_table(plant, law)
        opened, beside, gain = self.posed(plant, law)
        found = gain.values(opened, beside, alpha)
        return self._apart(plant, law, alpha, found) if self.scales_apart(plant, law) else found

    def _apart(self, plant: UncertainPlant, law: Any, alpha: Array, found: Array) -> Array:
        """Return values at points, each of the best of several scales: of the highest its own."""
        opened, beside, gain = self._alike(plant, law)
        found, highest = found.copy(), -np.inf
        for _ in range(MOST_SCALES):
            k = int(found.argmax())
            if not highest < found[k] * (1 - SAME) or not np.isfinite(found[k]):
                break
            weights, leads = _scale(opened, beside, gain, alpha[k : k + 1])
            loops = replace(gain.loops, weights=weights, leads=leads)
            near = found > highest
            own = _gain(self, opened, loops, beside).values(opened, beside, alpha[near])
            found[near] = np.minimum(found[near], own)
            highest = max(highest, found[k])
        return np.minimum(found, highest)  # of more points it is not known that they are worse

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the loops, behind their filters, as a channel at points alpha.

        What a law reads there is left out.
        """
        names = sorted(self.names, key=lambda name: TO in name)  # paths come last
        places = [place_of(plant, name, None) for name in names]
        A, B = plant.at(alpha)
        n, count, size = A.shape[-1], len(alpha), len(places)
        E, F = np.zeros((count, n, size)), np.zeros((count, size, size))
        C, D = np.zeros((count, size, n)), np.zeros((count, size, B.shape[-1]))
        reads = list[str | int | Acting]()
        for k, (kind, i) in enumerate(places):
            F[:, k, k] = (1 + self.sigma) / 2
            if kind == "input":
                E[:, :, k], D[:, k, i] = B[:, :, i], 1.0
            reads.append(i if kind == "input" else names[k])
        channel = Channel(A, B, E, C, D, F, np.eye(size), reads=tuple(reads))
        channel = with_paths(channel, plant, alpha, self.loops_of(plant, None))
        for k, shape in enumerate(self.shapes_at(plant)):
            channel = shaped(channel, k, shape.filter)
        return channel

    def unweighted(self) -> DiskMargin:
        """Return the disk margin without the filters."""
        known = {"time_invariant": self.time_invariant}
        return DiskMargin(self.signal, self.at_most, self.sigma, **known) if self.shapes else self

    def sampled(self, plant: UncertainPlant, law: Any, alpha: Array) -> LoopMargins:
        """Return the classical margins of its first loop at points alpha."""
        law = law_or_table(plant, law.as_law() if hasattr(law, "as_law") else law)
        self._require_cut(plant, law, self.loops_of(plant, law))
        return margins(opened(plant, law, self.names[0], alpha))

    def slopes(self, loops: ClosedLoops) -> Slopes:
        """Return peaks of the largest singular value with their slopes, loops weighed anew."""
        if loops.E.shape[-1] == 1:
            return Gain(self.names[0]).slopes(loops)
        return scales.slopes(loops, 0, 1.0, leads=self.time_invariant)


def shape_for(weight: Any, kind: str, *, constant: bool) -> Shape:
    """Return a weight as it was written, in s or in z."""
    in_z = isinstance(weight, str) and "z" in weight
    return Shape(shape_of(weight, kind, constant=constant, in_z=in_z), in_z=in_z)


def written_weight(weight: Any) -> Any:
    """Return a weight's text without spaces, that of a number too."""
    if is_number(weight) or isinstance(weight, Fraction):
        return exactly(float(weight))
    return "".join(weight.split()) if isinstance(weight, str) else weight


def require_flag(value: Any, kind: str, key: str = FLAG) -> None:
    """Refuse what is neither true nor false."""
    if not isinstance(value, bool):
        raise InputError(f"{key} = {shown(value)} of a {kind} must be true or false")


def flag_words(value: bool, key: str = FLAG) -> str:
    """Return what a title says of a key that is true or false."""
    return f" with {key} true" if value else ""


@dataclass(frozen=True)
class Unmodelled(DiskMargin):
    """How much dynamics that no model has inputs bear, in multiples of a weight.

    Of an actuator u becomes (1 + delta W) u, delta any stable system of L2 gain up to that
    multiple, one that varies in time among them; of several inputs each has its own delta. All
    stay stable if the gain of W T is below 1 over the multiple, T the complementary sensitivity.

    Attributes
    ----------
    signal : str or sequence of str
        Inputs by their names.
    at_most : float, optional
        Of 1 over the multiple; `least` takes the multiple itself.
    weight : str or mapping
        W, the share by which the input may be off at each frequency, as `with_weight` takes one.
    """

    weight: Any = ""
    kind = "unmodelled dynamics"
    keys = ("weight", "time_invariant")
    of_dynamics = True
    claimed = proof.Unmodelled

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "sigma", -1.0)
        object.__setattr__(self, "weight", written_weight(self.weight))
        _ = self.shapes

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        if "weight" not in row.table:
            raise InputError('weight is missing; write weight = "(3*s + 18.5)/(s + 46.3)"')
        own = {key: row.table[key] for key in cls.keys if key in row.table}
        return cls(row.table["signal"], **row.given(), **own)

    @property
    def title(self) -> str:
        """Kind, loops and weight, as a line has them."""
        whole = f"{self.kind} of {self.name} with weight {self.shapes[0].name}"
        return whole + flag_words(self.time_invariant)

    @classmethod
    def least(  # type: ignore[override]
        cls,
        loops: str | Sequence[str],
        weight: Any,
        at_least: float | None = None,
        *,
        time_invariant: bool = False,
    ) -> Self:
        """Return the requirement that so many times a weight are borne; None: as many as can be."""
        return cls(loops, level_of(at_least), weight=weight, time_invariant=time_invariant)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:  # type: ignore[override]
        """The weight at each loop."""
        shape = shape_for(self.weight, self.kind, constant=all_paths(self.names))
        return (shape,) * len(self.entries)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a sampled plant, and what is no input."""
        super().require_fit(plant)
        require_time(plant, self.shapes[0], self.title)
        require_dynamics(plant, self.names, self.title)

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has its weight."""
        return f"{self.title}: no LMI has its weight; leave out the method, so that a law is tuned"


def all_paths(names: Sequence[str]) -> bool:
    """Whether no name is that of an input."""
    return all(TO in name for name in names)


def require_time(plant: UncertainPlant, shape: Shape, title: str) -> None:
    """Refuse a weight in s of samples, and one in z of a plant in continuous time."""
    if shape.filter.states and shape.in_z != (plant.period > 0):
        letter, time = ("z", "at a sample time") if plant.period else ("s", "in continuous time")
        raise InputError(f"{title}: {plant.name} is {time}; write the weight in {letter}")


def require_dynamics(plant: UncertainPlant, names: Sequence[str], title: str) -> None:
    """Refuse what is neither an input nor a path: a name that the law measures."""
    for name in names:
        if place_of(plant, name, None)[0] == "measured":
            paths = f'a path from it, such as "{name}{TO}DISTURBANCE"'
            raise InputError(
                f"{title}: {name!r} is no input; name {paths}, or ask for its disk margin"
            )


def with_paths(
    channel: Channel,
    plant: UncertainPlant,
    alpha: Array,
    loops: Loops,
    acting: tuple[float, ...] = (),
) -> Channel:
    """Return a channel with its last loops, those of paths, put in.

    Parameters
    ----------
    acting : tuple of float, optional
        How many times each disturbance before those of loops acts; one where left out.
    """
    if not loops.paths:
        return channel
    E, C, D, F = (getattr(channel, key).copy() for key in "ECDF")
    reads, driven, own = list(channel.reads), plant.driven(alpha), len(acting)
    for k, path in enumerate(loops.paths):
        column = k - len(loops.paths)
        E[:, :, column] = driven[:, :, path.disturbance]
        reads[column] = Acting(path.disturbance)
        wide = beside_loops(path.output, loops)
        ends = ((C, wide.C), (D, wide.D), (F, wide.F))
        for M, rows in ((M, rows) for M, rows in ends if rows):
            M[:, column] = np.tensordot(alpha, np.array(rows, dtype=float)[:, 0], 1)
        F[:, column, :own] *= acting
    return replace(channel, E=E, C=C, D=D, F=F, reads=tuple(reads))


def shaped(channel: Channel, k: int, shape: Filter) -> Channel:
    """Return a channel with a filter behind its k-th output."""
    count, n, more = len(channel.A), channel.A.shape[-1], shape.states
    a = np.array(shape.a, dtype=float).reshape(more, more)
    b, c = (np.array(M, dtype=float).reshape(more) for M in (shape.b, shape.c))
    b = b[:, None]
    A = np.zeros((count, n + more, n + more))
    A[:, :n, :n], A[:, n:, :n], A[:, n:, n:] = channel.A, b * channel.C[:, k : k + 1], a
    B = np.concatenate([channel.B, b * channel.D[:, k : k + 1]], axis=1)
    E = np.concatenate([channel.E, b * channel.F[:, k : k + 1]], axis=1)
    C = np.pad(channel.C, ((0, 0), (0, 0), (0, more)))
    D, F, d = channel.D.copy(), channel.F.copy(), float(shape.d)
    C[:, k] *= d
    C[:, k, n:], D[:, k], F[:, k] = c, d * D[:, k], d * F[:, k]
    return replace(channel, A=A, B=B, E=E, C=C, D=D, F=F, filters=channel.filters + more)


@dataclass(frozen=True)
class LoopGain(Gain):
    """The gain at opened loops, whose claim is that of a disk margin."""

    loops: Loops = field(default_factory=lambda: Loops(()))
    invariant: bool = False
    margin: str = ""
    shapes: tuple[Shape, ...] = ()
    claimed: type[proof.DiskMargin] = proof.DiskMargin

    @property
    def title(self) -> str:
        """That of the margin."""
        return self.margin

    @property
    def filters(self) -> tuple[Any, ...]:
        """The shapes of unmodelled dynamics, and what the loops' leads are behind them."""
        leads = self.loops.behind
        if not leads:
            return self.shapes or super().filters
        whole: Filters = tuple(shape.filter if shape else None for shape in self.shapes)
        whole = whole or (None,) * len(self.entries)
        at_loops = map(in_turn, whole[-len(leads) :], leads)
        return tuple(one and Shape(one) for one in (*whole[: -len(leads)], *at_loops))

    @property
    def before(self) -> Filters:
        """What the loops' leads are before disturbances."""
        return self.loops.before

    def filtered(self, signals: Sequence[str | Output]) -> Specification:
        """Return it of the signals behind their filters."""
        bare, signal = replace(self.loops, leads=()), tuple(signals)
        return replace(self, signal=signal if len(signal) > 1 else signal[0], shapes=(), loops=bare)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the gain, of signals behind their filters."""
        if not any(self.filters):
            return super().values(plant, law, alpha)
        wide = behind(plant, law, self)
        return wide.specification.values(wide.plant, wide.law, alpha)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,  # noqa: ARG002
    ) -> proof.BoundClaim:
        """Return the claim about the margin."""
        invariant = self.invariant
        return _claimed(self.claimed, subject, self.loops, level, self.shapes, invariant=invariant)


def opened_subject(subject: proof.Subject, plant: UncertainPlant, loops: Loops) -> proof.Subject:
    """Return what a claim about a plant in its delta form is of, with its loops opened."""
    known = loops.plant(file_plant(plant))
    law = loops.law(subject.law, known)
    nodes = tuple(replace(v, E=loops.entering(v.B, v.E)) for v in subject.nodes)
    return replace(subject, E=known.E, law=law, remainder=known.remainder, nodes=nodes)


def _claimed(
    claimed: type[proof.DiskMargin],
    subject: proof.Subject,
    loops: Loops,
    level: Fraction,
    shapes: tuple[Shape, ...],
    *,
    invariant: bool,
) -> proof.BoundClaim:
    """Return the claim about opened loops, behind the filters that they have."""
    filters = tuple(shape.filter for shape in shapes)
    return claimed.of(subject, loops, level, filters, invariant=invariant)


def open_loops(plant: UncertainPlant, loops: Loops, law: Any = None) -> UncertainPlant:
    """Return a plant with the disturbances at loops in place of its own, or beside them.

    Its outputs are what a law beside it reads; states have names of their own.
    """
    n, m = plant.shape
    vertices = list[System]()
    for v in plant.vertices:
        B, own = (list(map(list, M)) for M in (v.exact_B, v.exact_E or ()))
        E = tuple(map(tuple, loops.entering(B, own)))
        vertices.append(System(v.exact_A, v.exact_B, E, v.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        disturbances=named_disturbances(loops),
        states=tuple(f"state {i + 1}" for i in range(n)),
        outputs=law.measured if isinstance(law, PolynomialGain) else (),
        noise=(),
        vehicle=None,
        remainder=loops.remainder(plant.remainder, n, m),
        opened=loops.columns(0, m)[m:],
    )


def named_disturbances(loops: Loops) -> tuple[str, ...]:
    """Return the names of the disturbances of opened loops."""
    own = (f"disturbance {k + 1}" for k in range(loops.own))
    return (*own, *(f"loop {k + 1}" for k in range(loops.count)))


def _gain(asked: DiskMargin, opened: UncertainPlant, loops: Loops, law: Any = None) -> LoopGain:
    """Return the gain from opened loops to what arrives there."""
    outputs = list[Output]()
    size, m = loops.count, opened.shape[1]
    passed = (1 + loops.skew) / 2
    rows = law.measured if isinstance(law, PolynomialGain) else ()
    for k, weight in enumerate(loops.weights[: size - len(loops.paths)]):
        F = [weight * passed * (j == k) for j in range(size)]
        if k < len(loops.inputs):
            D = [weight * (i == loops.inputs[k]) for i in range(m)]
            outputs.append(Output(f"loop {k + 1}", "", D=D, F=F))
            continue
        j = loops.measured[k - len(loops.inputs)]
        C, own = [[weight * x for x in row] for row in rows[j].C], F[len(loops.inputs) :]
        straight = [[weight * x for x in M[j]] for M in loops.through]
        at_inputs = [[row[i] for i in loops.inputs] for row in straight]
        every = [[*row, *own] for row in at_inputs or [F[: len(loops.inputs)]]]
        outputs.append(Output(f"loop {k + 1}", "", C=C, D=straight, F=every))
    outputs += seen_paths(loops)
    scales = {f"loop {k + 1}": float(x) for k, x in enumerate(loops.scales)}
    chosen = None if set(scales.values()) == {1.0} else scales
    return LoopGain(
        outputs if len(outputs) > 1 else outputs[0],
        asked.at_most,
        at=SAMPLES,
        disturbances=chosen,
        loops=loops,
        invariant=asked.time_invariant,
        margin=asked.title,
        shapes=asked.shapes_at(opened),
        claimed=asked.claimed,
    )


def reading_beside(plant: UncertainPlant, law: Any, loops: Loops) -> Any:
    """Return the law into whose signals the disturbances at loops pass, and no others."""
    if not isinstance(law, Law):
        if loops.measured:
            raise InputError("a table of gains has loops at inputs; name one")
        return law
    if isinstance(law, FixedGain) and loops.measured:
        count = len(plant.parameters) or len(plant.vertices)
        law = PolynomialGain(((0,) * count,), law.K[None], states(plant), plant.parameters)
    if not isinstance(law, PolynomialGain) or not (loops.measured or loops.through or law.passes):
        return law
    known = law.measured or states(plant)
    own = [y.exact(plant)[2] for y in known]
    vertices = range(len(plant.vertices))
    F = [loops.passing(j, [list(rows[j]) for rows in own]) for j in vertices]
    seen = (replace(y, F=[M[j] for M in F]) for j, y in enumerate(known))
    return replace(law, measured=tuple(seen))


def seen_paths(loops: Loops) -> list[Output]:
    """Return what is sent into paths, times the weights."""
    first, outputs = loops.count - len(loops.paths), list[Output]()
    for k, (path, weight) in enumerate(zip(loops.paths, loops.weights[first:], strict=True)):
        wide = beside_loops(path.output, loops)
        C, D, F = ([[weight * x for x in row] for (row,) in M] for M in (wide.C, wide.D, wide.F))
        near = wide.near and wide.near.mapped(partial(_times, weight))
        outputs.append(Output(f"loop {first + k + 1}", "", C=C, D=D, F=F, near=near))
    return outputs


def _times(weight: Fraction, M: Rows) -> Rows:
    return tuple(tuple(weight * x for x in row) for row in M)


def _on_the_way(plant: UncertainPlant) -> list[int]:
    """Return the numbers of the states that are demands on their way."""
    if plant.sampling is None:
        return []
    n, m = plant.sampling.plant.shape
    return list(range(n, n + plant.sampling.delay * m))


def paths_of(plant: UncertainPlant, names: Sequence[str]) -> tuple[Path, ...]:
    """Return the loops of names that are paths, from a signal to a disturbance."""
    paths = list[Path]()
    for name in names:
        if TO in name:
            _, j = place_of(plant, name, None)
            (exact,) = Gain(name.split(TO)[0]).exact_outputs(plant)
            paths.append(Path(exact, j))
    return tuple(paths)


def place_of(plant: UncertainPlant, name: str, law: Any) -> tuple[str, int]:
    """Return whether a loop is at an input or at what a law measures, and its number there.

    Of a path, written "SIGNAL -> DISTURBANCE", that of the disturbance.
    """
    if TO in name:
        signal, acting = name.split(TO, 1)
        plant.signal(signal)
        own = [w.name for w in disturbances(plant)]
        if acting not in own:
            raise InputError(f"{name!r}: no disturbance {acting!r}; {suggest(acting, own)}")
        return "path", own.index(acting)
    known = [signal.name for signal in inputs(plant)]
    for alias in (name, f"{DEMAND}{name}"):
        if alias in known:
            return "input", known.index(alias)
    read = _read(plant, law)
    for alias in as_read(name):
        if alias in read:
            return "measured", read.index(alias)
    what = "inputs" if law is None else "inputs, nor among what the law measures"
    raise InputError(
        f"no loop at {name!r}: it is not among the {what}; {suggest(name, [*known, *read])}"
    )


def _read(plant: UncertainPlant, law: Any) -> list[str]:
    """Return the names of what a law reads; of any, if it is None."""
    law = law.as_law() if hasattr(law, "as_law") else law
    of_states = [signal.name for signal in states(plant)]
    if law is None:
        return [*of_states, *(signal.name for signal in plant.every_output)]
    if isinstance(law, proof_laws.Law):
        return list(law.measured) or ([] if law.scheduled else of_states)
    if isinstance(law, PolynomialGain) and law.measured:
        return [signal.name for signal in law.measured]
    return of_states if isinstance(law, FixedGain | PolynomialGain) else []


def _signal(plant: UncertainPlant, name: str) -> Output:
    kind, i = place_of(plant, name, None)
    if kind == "path":
        return plant.signal(name.split(TO)[0])
    return inputs(plant)[i] if kind == "input" else plant.signal(_read(plant, None)[i])


def closed_loops(plant: UncertainPlant, law: Any, gain: Specification, alpha: Array) -> ClosedLoops:
    """Return the loops from what is added at opened loops to what arrives there."""
    wide = behind(plant, law, gain)
    closed = close(wide.plant, wide.law, alpha)
    channel = Gain.channel(cast("Gain", wide.specification), delta_form(wide.plant), alpha)
    return channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)


def may_part(plant: UncertainPlant, law: Any) -> bool:
    """Whether a claim about a law may be proved in parts of the box, each with its scale."""
    fixed = plant.dead_time is None and not plant.moving
    return fixed and bool(plant.parameters) and isinstance(law, Law) and law.divisible(plant)


def _scale(
    plant: UncertainPlant, law: Any, gain: LoopGain, alpha: Array
) -> tuple[tuple[Fraction, ...], tuple[tuple[Fraction, Fraction], ...]]:
    """Return weights and leads for which the gain of D M D^-1 is about least at points alpha."""
    loops = closed_loops(plant, law, gain, alpha)
    if not np.all(growth(loops.modes.poles, loops.modes.step) < 0):
        return gain.loops.weights, ()
    leads = gain.invariant and plant.dead_time is None  # a proof with one has none
    return scales.scaled(loops, 0, 1.0, leads=leads).scale.exact
