"""Specifications: what of a signal, or of the law, is to be small or to stay within a limit."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self, cast

import numpy as np

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.conditions.gain_norm import Norm
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.plant.delta import delta_form
from polefence.plant.exact import matrices_of, ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal, disturbances, rows_at, stacked
from polefence.plant.parts import node
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof import laws
from polefence.proof.between import Held
from polefence.proof.claims.signal import MAX_ENTRIES
from polefence.proof.laws import Evidence, inner_points
from polefence.proof.matrices import Rationals
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up, exactly
from polefence.requirements.slopes import Channel, Loops, Slopes
from polefence.response.held import Storing, storing

SMALLEST, LARGEST = 1e-30, 1e30  # of a scale: its square, times that of E, is to be a double
SIGNAL_REMEDY = (
    'name a state or an input, or of a quarter car for example "sprung-mass acceleration"'
)
BestScale = tuple[Array, float]  # of opened loops at one point, and the level it leads to
# Names that need no quotes in a list.
_PLAIN = re.compile(r"""[^\s,*\[\]"]([^,*\[\]"]*[^\s,*\[\]"])?""")


@dataclass(frozen=True)
class Row(Short):
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

    def given(self, *keys: str) -> dict[str, Any]:
        """Return limit, disturbances and these keys as numbers, those of them that are given."""
        table, where = self.table, self.where
        values: dict[str, Any] = {
            key: number(table[key], f"{where}: {key}") for key in ("at_most", *keys) if key in table
        }
        if "disturbances" in table:
            values["disturbances"] = _chosen(table["disturbances"], f"{where}: disturbances")
        return values


@dataclass(frozen=True)
class Specification(Short):
    """A signal, and the largest value that it may have; None where it is to be small.

    Attributes
    ----------
    signal : str or Output, or a sequence of them
        A state, an input or an output; for some kinds a vector of up to `MAX_ENTRIES`, each once.
    at_most : float, optional
        In the signal's unit.
    disturbances : sequence of str, or mapping of str to float, optional
        Those that act, by name; with a mapping this many times each: w = diag(s) v, and what is
        bounded is of v. All, as they are, by default; but noise of sensors (`UncertainPlant.noise`)
        acts by default on an rms alone, and with its own density. Held as pairs of name and number.

    Raises
    ------
    InputError
        If the limit or a scale is no positive number, or the signal is none that the kind is of.
    """

    signal: str | Output | Signal | Sequence[str | Output]
    at_most: float | None = None
    disturbances: Any = field(default=None, kw_only=True)

    vector: ClassVar[bool] = False  # whether it may be of a vector of signals
    keys: ClassVar[tuple[str, ...]] = ()  # of a table, besides kind, signal, at_most, minimise
    moved_by: ClassVar[str] = "disturbances"  # the key of what a line names behind from
    of_signal: ClassVar[bool] = True  # else of the law
    limits_rms: ClassVar[bool] = False  # whether its limit is one on an rms, not on a ratio of two
    direct: ClassVar[bool] = False  # whether a disturbance may pass straight into the signal
    late_as: ClassVar[str | None] = None  # what its claim has of plants with a dead time
    power: ClassVar[int] = 2  # of the bound, that grows with the r of a condition
    of_loops: ClassVar[bool] = True  # of a margin, whether its signals are loops; one needs a size
    is_margin: ClassVar[bool] = False  # whether people read 1 over its level, which is to be large

    @explained_fields
    def __post_init__(self) -> None:
        self._settle("signal", _signals(self.signal, self.kind, self.vector))
        if self.disturbances is not None:
            if not self.of_signal:
                raise InputError(f"a {self.kind} takes no disturbances; leave them out")
            self._settle("disturbances", _channels(self.disturbances))
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
        return cls(row.table["signal"], **row.given())

    @classmethod
    def signal_of(cls, value: Any) -> Any:
        """Return the signal of a table or a line: a name, or a list of names.

        Parameters
        ----------
        value : Any
            Of a list on a line with numbers, ``[a * 2, b]``, a mapping.

        Raises
        ------
        SpecError
            If the kind is of no such signal.
        """
        names = value if isinstance(value, list) else [value]
        if names and all(isinstance(name, str) for name in names):
            return value
        if isinstance(value, Mapping):
            raise SpecError("signals have no scales; define a weighted one in [outputs]")
        for k, name in enumerate(names):
            if isinstance(value, list) and not isinstance(name, str):
                raise SpecError(f"signal[{k + 1}] = {shown(name)} must be text; {SIGNAL_REMEDY}")
        written = "an empty list" if value == [] else shown(value)
        raise SpecError(f"signal = {written} must be text, or a list of names; {SIGNAL_REMEDY}")

    def of(self, output: Output) -> Specification:
        """Return it of one other output."""
        return replace(self, signal=output)

    def _settle(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # it is frozen

    @property
    def entries(self) -> tuple[str | Output, ...]:
        """The signals, one or the entries of a vector."""
        entries = self.signal if isinstance(self.signal, tuple) else (self.signal,)
        # a bound on the law has no signal, and is not asked
        return cast("tuple[str | Output, ...]", entries)

    @property
    def name(self) -> str:
        """The signal's name; of a vector its entries' names, ``[a, b]``."""
        names = [entry if isinstance(entry, str) else entry.name for entry in self.entries]
        return listed(names) if len(names) > 1 else names[0]

    @property
    def title(self) -> str:
        """Kind, signal and what moves it, as a line has them."""
        moved = dict(getattr(self, self.moved_by) or ())
        ends = ["" if s == 1 else f" * {exactly(s)}" for s in moved.values()]
        acting = f" from {listed(list(moved), ends)}" if moved else ""
        return f"{self.kind} of {self.name}{acting}"

    @property
    def kind(self) -> str:
        """The bounded measure of the signal."""
        raise NotImplementedError

    @property
    def surely(self) -> Specification:
        """A limit that is exceeded only where this one is refuted: itself, in most kinds."""
        return self

    @property
    def presumed(self) -> tuple[Specification, ...]:
        """Limits without which it has no value, of a stable loop: none, in most kinds."""
        return ()

    @property
    def by_transfer_alone(self) -> bool:
        """Whether nothing else than the transfer function proves it."""
        return False

    def posed(self, plant: UncertainPlant, law: Law) -> tuple[UncertainPlant, Law, Specification]:
        """Return the plant, the law and the bound in which it is proved: themselves, in most."""
        return plant, law, self

    @property
    def limit(self) -> float | None:
        """The limit as people read it, None where there is none."""
        return None if self.at_most is None else self.read_as(self.at_most)

    def read_as(self, level: float) -> float:
        """Return the number that people read of a level: itself, in most kinds."""
        return level

    def proved_text(self, level: float) -> str:
        """Return what is proved, rounded to the weaker side."""
        return digits_up(level)

    def bound_text(self, level: float) -> str:
        """Return a proved bound as a line."""
        return f"{self.title} {'>=' if self.is_margin else '<='} {self.proved_text(level)}"

    def sampled_text(self, level: float) -> str:
        """Return what is sampled, rounded to the other side."""
        return digits_down(level)

    @property
    def filters(self) -> tuple[Any, ...]:
        """The filter that each of its outputs goes through first."""
        return (None,) * len(self.entries)

    @property
    def before(self) -> tuple[Any, ...]:
        """The filter before each disturbance, in the delta form of samples; empty without any."""
        return ()

    def filtered(self, signals: Sequence[str | Output]) -> Specification:
        """Return it of the signals behind their filters."""
        return replace(self, signal=signals)

    def arriving(self, plant: UncertainPlant, n: int) -> UncertainPlant:  # noqa: ARG002
        """Return the plant with its filters, from the n-th state on, as what it asks is of."""
        return plant

    def ways(
        self,
        plant: UncertainPlant,  # noqa: ARG002
        law: Any,  # noqa: ARG002
    ) -> tuple[tuple[float | None, Specification], ...]:
        """Return what proves it, the most promising first.

        Each with a level from which its least one is looked for, where it is posed for a level;
        None of a kind that is posed alike for every level, as most are.
        """
        return ((None, self),)

    @property
    def coupled(self) -> bool:
        """Whether `slopes` at one point depend on the other points."""
        return False

    def scales_apart(self, plant: UncertainPlant, law: Any) -> bool:  # noqa: ARG002
        """Return whether parts of the box may have scales of opened loops of their own."""
        return False

    def best_scales(self, plant: UncertainPlant, law: Any, alpha: Array) -> Iterator[BestScale]:
        """Yield the best scale at each point alpha, and the level it leads to."""
        raise NotImplementedError

    def unweighted(self) -> Specification:
        """Return it of the signal itself."""
        return self

    def extended(self, n: int, more: int) -> Specification:  # noqa: ARG002
        """Return the requirement for a plant with more states behind its n, initially at rest."""
        return self

    def in_units_of(self, other: Specification) -> Specification:  # noqa: ARG002
        """Return the requirement in the units of another of its kind."""
        return self

    def law_norm(self, plant: UncertainPlant, unit: float | None = None) -> Norm | None:  # noqa: ARG002
        """Return the bound on the law; None for a requirement on a signal."""
        return None

    def level(self, r: float) -> float:
        """Return the bound that a condition's r is, where it has no limit."""
        return float(r if self.power == 1 else math.sqrt(r))

    def outputs(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return what is bounded of the `signals`: they themselves, in most kinds."""
        return self.signals(plant)

    def signals(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return the signal, or the entries of a vector.

        Raises
        ------
        InputError
            If there is none of a name.
        """
        return tuple(plant.signal(s) if isinstance(s, str) else s for s in self.entries)

    def scales(self, plant: UncertainPlant) -> tuple[float, ...]:
        """Return how many times each disturbance acts; nothing where each does as it is.

        Where none are named, noise of sensors counts `unnamed_noise` times.

        Raises
        ------
        InputError
            If there is none of a name.
        """
        if self.disturbances is None:
            physical = plant.physical
            if all(physical) or not (any(physical) or self.unnamed_noise):
                return ()
            return tuple(1.0 if acts else self.unnamed_noise for acts in physical)
        disturbance(plant)
        names, chosen = [w.name for w in disturbances(plant)], dict(self.disturbances)
        for name in chosen:
            if name not in names:
                raise InputError(f"no disturbance {name!r}; {suggest(name, names)}")
        scales = tuple(float(chosen.get(name, 0.0)) for name in names)
        return () if all(scale == 1 for scale in scales) else scales

    def worst_frequency(
        self,
        plant: UncertainPlant,  # noqa: ARG002
        law: Any,  # noqa: ARG002
        alpha: Array,  # noqa: ARG002
    ) -> float | None:
        """Return where it is worst at a point (N,) [rad/s]; None of what has no frequency."""
        return None

    @property
    def noise_density(self) -> float | None:
        """One-sided density of the noise that moves the signal; None where no noise does."""
        return None

    @property
    def unnamed_noise(self) -> float:
        """How many times noise of sensors acts where no disturbances are named: not at all."""
        return 0.0

    def scaled(self, plant: UncertainPlant, matrices: Any) -> Any:
        """Return E, F or a response (..., q), each column times its disturbance's scale."""
        scales = self.scales(plant)
        return matrices * np.array(scales) if scales else matrices

    def squares(self, plant: UncertainPlant) -> Any:
        """Return the squares of the disturbances' scales, (q,); 1 where each acts as it is."""
        scales = self.scales(plant)
        return np.square(scales) if scales else 1.0

    def entering(self, plant: UncertainPlant) -> Array:
        """Return E at the vertices, (N, n, q), of the disturbances as they are scaled.

        Raises
        ------
        InputError
            If the plant has none.
        """
        return np.asarray(self.scaled(plant, disturbance(plant)))

    def driving(self, plant: UncertainPlant, law: Law | None = None) -> tuple[Array, int]:
        """Return Bernstein coefficients of E, scaled, (count, n, q), and their degree.

        Parameters
        ----------
        law : Law, optional
            Of the loop whose E is meant: with what passes through it.

        Raises
        ------
        InputError
            If the plant has none.
        """
        passes = law is not None and law.passes
        if plant.curve_degree == 1 and not passes:
            return self.entering(plant), 1
        disturbance(plant)
        degree, domain = _passed_degree(plant, law)
        at = domain.nodes(degree)
        E, passing = plant.driven(at), None if law is None else law.passing(at)
        if passing is not None:
            E = E + plant.at(at)[1] @ passing
        return np.asarray(self.scaled(plant, domain.interpolated(E, degree))), degree

    def through(self, plant: UncertainPlant, law: Law | None = None) -> tuple[Array | None, int]:
        """Return coefficients of F of the outputs, (count, p, q), as `driving` does those of E.

        None where F is zero.
        """
        (_, D, F), degree = stacked(plant, self.outputs(plant)), 1
        if law is not None and law.passes:
            degree, domain = _passed_degree(plant, law)
            at = domain.nodes(degree)
            passing = law.passing(at)
            D, F = (np.tensordot(at, M, 1) for M in (D, F))
            F = F if passing is None else F + D @ passing
            F = domain.interpolated(F, degree)
        F = np.asarray(self.scaled(plant, F))
        return (F if np.any(F) else None), degree

    def passed(self, plant: UncertainPlant, F: Array) -> Array:
        """Return of what passes into a law's signals, (..., q), what its disturbances pass."""
        return np.asarray(self.scaled(plant, F))

    def require_samples(self, plant: UncertainPlant, F: Array | None) -> None:
        """Refuse what passes into a law's signals at samples of a plant in continuous time.

        Raises
        ------
        InputError
            Saying what to do.
        """
        if F is not None and plant.sampling is not None and np.any(self.passed(plant, F)):
            raise InputError(
                f"{self.title}: a disturbance passes straight into what the law measures, and at a "
                "sample white noise has no finite variance, nor has one of bounded energy a "
                "bounded value; give the sensor a bandwidth"
            )

    def easier(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say what to ask instead where no law was found; nothing in most kinds."""
        return ""

    def unit(self, plant: UncertainPlant) -> str:
        """Return the unit of the bound, or the units of the entries where they differ."""
        units = [output.unit for output in self.outputs(plant)]
        if len(set(units)) > 1:
            return f"mixed units: {', '.join(unit or '1' for unit in units)}"
        return units[0]

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without the signal, or without what moves it.

        Raises
        ------
        InputError
            Saying what is missing.
        """
        disturbance(plant)
        self.require_late(plant, self.exact_outputs(plant))

    def require_late(self, plant: UncertainPlant, outputs: Sequence[Any] = ()) -> None:
        """Refuse a plant with a dead time, where nothing of this kind is proved of it.

        Raises
        ------
        InputError
        """
        if plant.dead_time is None:
            return
        if self.late_as is None:
            raise InputError(
                f"{self.title}: of a plant with a dead time rms, gain and energy peak are bounded"
            )
        for output in outputs:
            if self.late_as == "rms" and any(map(plant.is_late, (output.C, output.D))):
                raise InputError(
                    f"{self.title}: it is late itself; bound it by its gain, or give the input an "
                    "actuator with a bandwidth"
                )

    def source(
        self, plant: UncertainPlant, domain: Domain, law: Law | None = None
    ) -> conditions.Source:
        """Return the source of the signal's motion; of the loop of a law that is given."""
        raise NotImplementedError

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,
        unit: float | None = None,
        law: Law | None = None,
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return it as an LMI has it; with a ``unit`` its bound is not fixed.

        Parameters
        ----------
        law : Law, optional
            One that is given: disturbances may pass through it.

        Raises
        ------
        InputError
            If no LMI has it.
        """
        if why := self.beyond_lmi(plant):
            raise InputError(why)
        outputs = self.exact_outputs(plant)
        C, D = (
            np.concatenate([floats(getattr(output, key)) for output in outputs], axis=1)
            for key in "CD"
        )
        source, level = self.source(plant, domain, law), self.at_most if unit is None else unit
        level = 1.0 if level is None else level
        return source, conditions.Output(self.title, source.name, C, D, level, unit is None)

    @property
    def driven_by(self) -> float:
        """The ratio of the dual's disturbances to those of X in the claim."""
        return 1.0

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:  # noqa: ARG002
        """Return the closed loops as the dual form of the bound has them; None where it has none.

        The bound is then the root of tr E'QE, or the gain.
        """
        return None

    def _dual(
        self, plant: UncertainPlant, law: Law, size: float, gain: bool = False
    ) -> DualProblem:
        """Return the loops whose disturbances are so many times as large."""
        outputs = self.outputs(plant)
        C, D, F = stacked(plant, outputs)
        E, near = size * self.entering(plant), tuple(output.near for output in outputs)
        acting = size * np.array(self.scales(plant) or (1.0,) * E.shape[-1])
        return DualProblem(plant, law, C, D, E, acting * F, acting, gain, near=near)

    def _storing(self, plant: UncertainPlant, held: Held, size: float = 1.0) -> Storing:
        """Return the plant between samples, whose disturbances are so many times as large."""
        _, _, F = stacked(plant, self.outputs(plant))
        scales = size * np.array(self.scales(plant) or [1.0] * len(held.E[0][0]))
        through = np.asarray(self.scaled(plant, F))
        return storing(held, self.exact_outputs(plant), through, scales, plant.shape)

    def exact_outputs(self, plant: UncertainPlant) -> tuple[proof.Output, ...]:
        """Return the signal, or the entries of a vector, in exact rationals.

        Raises
        ------
        InputError
            If a disturbance passes straight into one, unless it may, or goes through a filter.
        """
        outputs = []
        for output, behind in zip(self.outputs(plant), self.filters, strict=True):
            acts = np.any(self.scaled(plant, output.arrays(plant)[2]))
            direct = self.direct or behind is not None
            C, D = rows(plant, replace(output, F=()) if output.F and not acts else output, direct)
            F = tuple([list(row)] for row in output.exact(plant)[2]) if output.F else ()
            outputs.append(proof.Output(C, D, output.name, F, near=output.near))
        return tuple(outputs)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim that the bound is kept."""
        raise NotImplementedError

    def cut_off(self, plant: UncertainPlant) -> tuple[int, ...]:  # noqa: ARG002
        """Return the numbers of inputs that are cut off at the bound."""
        return ()

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return what is bounded at points alpha (count, N), in floats.

        Raises
        ------
        InputError
            If a loop is not stable, or a response cannot be computed.
        """
        raise NotImplementedError

    def readable(
        self,
        plant: UncertainPlant,  # noqa: ARG002
        known: tuple[str, ...],
    ) -> tuple[str, ...]:
        """Return which of these signals a law may measure: all of them, in most kinds."""
        return known

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say why no LMI designs a law for it; nothing where one does."""
        return ""

    def has_primal(self, plant: UncertainPlant) -> bool:  # noqa: ARG002
        """Whether the bound is proved by a polynomial about as large as the covariance, too."""
        return True

    def borne(self, plant: UncertainPlant, law: Any) -> int | None:  # noqa: ARG002
        """Return how many samples in a row the loop bears to lose; None where it is not said."""
        return None

    def at_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array | None:  # noqa: ARG002
        """Return the value at samples alone, where the bounded one is another; else None."""
        return None

    def tuned(self, times: float) -> tuple[Specification, ...]:  # noqa: ARG002
        """Return the requirements that replace it in the search for a structured law.

        Parameters
        ----------
        times : float
            How far an input that is cut off may go beyond its limit.
        """
        return (self,)

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the source and the signal as a channel at points alpha (count, N)."""
        disturbance(plant)
        E = self.scaled(plant, plant.driven(alpha))
        C, D, F = rows_at(plant, self.outputs(plant), alpha)
        S = np.diag(self.scales(plant) or (1.0,) * E.shape[-1])
        return Channel(*plant.at(alpha), E, C, D, self.scaled(plant, F), S)

    def is_of_noise(self, channel: Channel) -> bool:  # noqa: ARG002
        """Whether `slopes` of its channel are those of `polefence.requirements.slopes.of_noise`."""
        return False

    def slopes(self, loops: Loops) -> Slopes:
        """Return the bounded quantity of stable closed loops of its `channel`, with slopes."""
        raise NotImplementedError


def limit_text(limit: Specification) -> str:
    """Return a specification and its limit, which reads back as it is."""
    if limit.at_most is None:
        return limit.title
    if limit.is_margin:
        return f"{limit.title} >= {exactly(limit.limit or 0.0)}"
    return f"{limit.title} <= {exactly(limit.at_most)}"


def _passed_degree(plant: UncertainPlant, law: Law | None) -> tuple[int, Domain]:
    """Return the degree of what passes through a law and B, or of E, and where it is one."""
    if law is None or not law.passes:
        return plant.curve_degree, plant.domain
    return plant.curve_degree + law.passing_degree, law.domain_of(plant)


def listed(names: Sequence[str], ends: Sequence[str] = ()) -> str:
    """Return names as ``[a, b]``, those in quotes that would be read as something else.

    Parameters
    ----------
    ends : sequence of str, optional
        What follows each.
    """
    plain = [
        name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False) for name in names
    ]
    return f"[{', '.join(map(str.__add__, plain, ends or [''] * len(plain)))}]"


def _signals(value: Any, kind: str, vector: bool) -> Any:
    """Return one signal, or a vector of them as a tuple."""
    if isinstance(value, str | Signal):
        return value
    entries = tuple(value) if isinstance(value, Sequence) else ()
    if not entries or not all(isinstance(entry, str | Output) for entry in entries):
        raise InputError(
            f"signal of {kind} = {value!r} must be a name, an Output or a list of them"
        )
    names = [entry if isinstance(entry, str) else entry.name for entry in entries]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"signal {listed(names)}: {twice[0]!r} is given twice; give it once")
    if len(entries) == 1:
        return entries[0]
    if not vector:
        raise InputError(
            f"signal {listed(names)} is a vector; {kind} takes one "
            "signal, rms and gain take several"
        )
    if len(entries) > MAX_ENTRIES:
        raise InputError(f"{kind} of {len(entries)} signals; at most {MAX_ENTRIES} are supported")
    return entries


def _channels(value: Any) -> tuple[tuple[str, float], ...]:
    """Return pairs of a disturbance's name and scale."""
    value = [value] if isinstance(value, str) else value
    pairs = list(value.items()) if isinstance(value, Mapping) else value
    if isinstance(pairs, Sequence):
        pairs = [(pair, 1.0) if isinstance(pair, str) else pair for pair in pairs]
    good = isinstance(pairs, Sequence) and all(
        isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], str) for pair in pairs
    )
    if not good or not pairs:
        raise InputError(
            f"disturbances = {value!r} must be names, or a mapping of names to numbers; name one"
        )
    names = [name for name, _ in pairs]
    for name, scale in pairs:
        if names.count(name) > 1:
            raise InputError(f"disturbance {name!r} is given twice; give it once")
        if not (is_number(scale) and scale > 0):
            raise InputError(f"disturbance {name!r} times {shown(scale)}: give a positive number")
        if not SMALLEST <= scale <= LARGEST:
            raise InputError(
                f"disturbance {name!r} times {scale:g}: give a number from {SMALLEST:g} to "
                f"{LARGEST:g}, or use another unit"
            )
    return tuple((name, float(scale)) for name, scale in pairs)


def _chosen(value: Any, where: str) -> Any:
    """Return disturbances as a spec has them: a list of names, or a table of numbers."""
    if isinstance(value, dict):
        return {name: number(scale, f"{where}.{name}") for name, scale in value.items()}
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise SpecError(
            f'{where} = {shown(value)} must be a list of names, ["road"], or a table of numbers, '
            "{road = 0.5}"
        )
    return value


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # of an integer that is no double
        return False


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
    matrices = [v.E for v in plant.vertices]
    if any(E is None for E in matrices):
        raise InputError(
            f"{plant.name} has no E, so no disturbance enters; give E for every vertex, or in "
            "[matrices]"
        )
    return np.stack([E for E in matrices if E is not None])


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
        raise InputError(
            f"a disturbance passes straight into {signal.name!r}; bound its gain, or choose others "
            "by disturbances"
        )
    C, D, _ = signal.exact(plant)
    return [[list(row)] for row in C], [[list(row)] for row in D]


def floats(matrices: list[Rationals]) -> Array:
    """Return exact matrices as an array."""
    return np.array([[[float(x) for x in row] for row in M] for M in matrices])


def claim_of(
    plant: UncertainPlant,
    law: laws.Law,
    on: str,
    specification: Specification,
    evidence: Evidence,
    level: Fraction,
) -> proof.BoundClaim:
    """Return a specification of a law as a claim, in exact rationals.

    Of a plant in discrete time, or in its delta form.
    """
    plant = delta_form(plant)
    motion = ranges_of(plant) if plant.moving else ()
    matrices, timing = matrices_of(plant), (plant.step, plant.remainder, motion)
    points = inner_points([evidence], plant.remainder) if plant.noded else ()
    nodes = tuple(node(plant, at) for at in points)
    subject = proof.Subject(*matrices, law, evidence, on, *timing, nodes=nodes)
    return specification.claim(subject, level, plant)
