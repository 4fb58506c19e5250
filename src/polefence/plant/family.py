"""Uncertain plants: a polytope of linear systems, given by its vertices or by its parameters."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import (
    InputError,
    PlantError,
    SpecError,
    shown,
    suggest,
)
from polefence.base.explained import explained, explained_fields
from polefence.plant.card import card
from polefence.plant.controllability import PRIME, surely_controllable
from polefence.plant.entries import NOT_RATIONAL, OUTPUTS, Read
from polefence.plant.evaluated import beyond
from polefence.plant.expression import CallError, RationalFunction, counted, evaluate
from polefence.plant.outputs import (
    Output,
    disturbances,
    inputs,
    pick,
    rate_named,
    split,
    states,
    without_inputs,
)
from polefence.plant.parameters import Parameter, check_label, check_name, exact, simplex_weights
from polefence.plant.polynomial import Domain
from polefence.plant.surface import Surface, of_one_argument
from polefence.plant.system import Array, Exact, System, floats
from polefence.plant.vehicle import OF_A_CAR, Vehicle
from polefence.proof.approximation import Functions
from polefence.proof.between import Clock, Held
from polefence.proof.dead_time import DeadTime
from polefence.proof.fitted import Data
from polefence.proof.functions import FUNCTIONS, Table, Tree, lift, variable
from polefence.proof.matrices import MAX_BITS, common_denominator
from polefence.proof.plant import Node
from polefence.proof.reading import MAX_VERTICES
from polefence.proof.remainder import Remainder, Source
from polefence.proof.short import Short
from polefence.proof.text import plural
from polefence.proof.work import FormatError

if TYPE_CHECKING:
    from polefence.plant.cars import Car


@dataclass(frozen=True)
class SamplesOf(Short):
    """What a plant is the samples of.

    Attributes
    ----------
    plant : UncertainPlant
        In continuous time.
    delay : int
        How many samples late an input acts; how many are on their way.
    early : Fraction
        Of a period, by how much it acts sooner than that: at least 0, below 1.
    terms : int
        Of the exponential's series, with which the remainder is proved.
    units : tuple of Fraction
        Of states, inputs and disturbances, in which it is evaluated.
    clock : Clock, optional
        How far apart samples may be, where that is not always the same.
    """

    plant: UncertainPlant
    delay: int
    terms: int
    units: tuple[Fraction, ...]
    clock: Clock | None = None
    early: Fraction = Fraction(0)

    @property
    def late(self) -> Fraction:
        """How many samples late an input acts, whole or not."""
        return self.delay - self.early

    @cached_property
    def known(self) -> dict[tuple[Fraction, ...], list[list[Fraction]]]:
        """Samples at points of the box that were asked for."""
        return {}

    @cached_property
    def held(self) -> Held | None:
        """What goes on between samples, with what was computed of it.

        None without noise, and of a plant with functions of the parameters.
        """
        if self.plant.functions is not None:
            return None
        A, B, E = (
            [list(map(list, M)) for v in self.plant.vertices if (M := getattr(v, key)) is not None]
            for key in ("exact_A", "exact_B", "exact_E")
        )
        units = self.units[: sum(self.plant.shape)]
        return Held(A, B, E, self.delay, units, self.clock, self.early) if E else None


@dataclass(frozen=True, repr=False)
class UncertainPlant(Short):
    """The convex hull of ``vertices``; with ``parameters``, the corners of their box.

    Vertex order: the first parameter varies slowest, each from its low to its high bound, so that
    alpha is the Kronecker product of the parameters' barycentric coordinates.

    Parameters
    ----------
    vertices : tuple of System
        All of one shape.
    parameters : tuple of Parameter
        Empty for a plant given by its vertices, else ``len(vertices) == 2**len(parameters)``.
    name, states, inputs, disturbances
        For people; signal names carry their SI unit in brackets.
    sample_time : number, optional
        Of a discrete-time plant x(t + sample_time) = A x(t) + B u(t) [s].
    outputs : tuple of Output
        What is measured or cared about besides states and inputs, and what a vehicle gives.
    vehicle : Vehicle, optional
        Which signals are those of a car.
    noise : tuple of str
        Disturbances, by their names without the unit, that are noise of sensors: white, of the
        one-sided density 1 whatever else acts.
    step : Fraction, optional
        Of a plant in delta form, (x(t + step) - x(t)) / step = A x(t) + B u(t) [s]; see
        `polefence.plant.delta`. Zero in continuous time.
    remainder : Remainder, optional
        Where the plant is only near combinations of its vertices: by how much.
    sampling : SamplesOf, optional
        What it is the samples of.
    car : Car, optional
        Of a table [car], at its parameters' low ends; a quarter car has a ``vehicle``.
    functions : Functions, optional
        Of the parameters, where entries are some: the remainder says which, and outputs do.
    data : Data, optional
        What it was fitted to: whatever is said of it also says that this is unproved.
    opened : tuple of int or None
        Where its disturbances are those of loops that are opened: which column of [B, E] of the
        plant itself each has, None of one that adds to what a law measures.
    driven_by : tuple of (int, int, Fraction)
        States of filters before its disturbances: which, before which, and how many times its
        column of E theirs is.

    Raises
    ------
    PlantError
        If the shapes differ, names do not fit, or there are too many vertices.
    """

    vertices: tuple[System, ...]
    parameters: tuple[Parameter, ...] = ()
    name: str = "plant"
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    disturbances: tuple[str, ...] = ()
    sample_time: Fraction | None = None
    outputs: tuple[Output, ...] = ()
    vehicle: Vehicle | None = None
    noise: tuple[str, ...] = ()
    step: Fraction = Fraction(0)
    remainder: Remainder | None = None
    sampling: SamplesOf | None = None
    car: Car | None = field(default=None, compare=False)  # dumps writes its matrices alone
    functions: Functions | None = None
    data: Data | None = None
    opened: tuple[int | None, ...] = ()
    driven_by: tuple[tuple[int, int, Fraction], ...] = ()

    @explained_fields
    def __post_init__(self) -> None:
        check_label(self.name, "name")
        for key in ("states", "inputs", "disturbances"):
            for label in getattr(self, key):
                check_label(label, f"a name of {key}")
        if not self.vertices:
            raise PlantError("a plant needs at least one vertex")
        if len(self.vertices) > MAX_VERTICES:
            raise PlantError(f"{len(self.vertices)} vertices; at most {MAX_VERTICES} are supported")
        first = self.vertices[0]
        for vertex in self.vertices[1:]:
            if vertex.shape != first.shape:
                raise PlantError(
                    f"{vertex.name} has {vertex.shape[0]} states and {vertex.shape[1]} inputs; "
                    f"{first.name} has {first.shape[0]} and {first.shape[1]}, they must agree"
                )
            if _width(vertex.exact_E) != _width(first.exact_E):
                raise PlantError(f"{vertex.name}: E differs in shape from that of {first.name}")
        if _common_bits(self.vertices) > MAX_BITS:
            raise PlantError("the entries' common denominator is too large; round them")
        if self.sample_time is not None:
            seconds = exact(self.sample_time, "sample_time")
            if seconds <= 0:
                raise PlantError(f"sample_time = {float(seconds):g} must be positive")
            object.__setattr__(self, "sample_time", seconds)
        names = [p.name for p in self.parameters]
        if len(set(names)) < len(names):
            raise PlantError(f"parameter names repeat: {', '.join(names)}")
        if names and len(self.vertices) != 2 ** len(names):
            raise PlantError(f"{len(names)} parameters need {2 ** len(names)} vertices")
        widths = (self.shape[0], self.shape[1], _width(first.exact_E))
        for attribute, width in zip(("states", "inputs", "disturbances"), widths, strict=True):
            given = getattr(self, attribute)
            if given and len(given) != width:
                raise PlantError(
                    f"{attribute} names {len(given)} signals; the matrices have {width}"
                )
        known = [signal.name for signal in disturbances(self)]
        for name in self.noise:
            if name not in known:
                raise PlantError(f"noise: no disturbance {name!r}; {suggest(str(name), known)}")
        if self.moving and self.remainder is not None and self.remainder.source is None:
            raise PlantError(
                f"parameter {self.moving[0].name}: rate: samples of a plant in continuous time are "
                "for constant parameters only; leave out rate"
            )
        self._read_outputs()

    @property
    def moving(self) -> tuple[Parameter, ...]:
        """The parameters that move."""
        return tuple(parameter for parameter in self.parameters if parameter.rate is not None)

    @property
    def dead_time(self) -> tuple[int, DeadTime] | None:
        """The number of the parameter that stands for a dead time, and what it is of."""
        known = enumerate(self.parameters)
        return next(((f, p.dead_time) for f, p in known if p.dead_time is not None), None)

    def require_on_time(self, what: str, remedy: str) -> None:
        """Refuse a plant with a dead time where nothing of this kind is proved of it.

        Raises
        ------
        InputError
        """
        if self.dead_time is not None:
            signal = self.dead_time[1].signal
            raise InputError(f"{self.name}: {signal!r} has a dead time, {what}; {remedy}")

    def is_late(self, rows: Sequence[Any]) -> bool:
        """Whether a row, one for all vertices or one each, depends on what has a dead time."""
        if self.dead_time is None or len(rows) < 2:
            return False
        bit = 1 << (len(self.parameters) - 1 - self.dead_time[0])
        return any(row != rows[j ^ bit] for j, row in enumerate(rows))

    @property
    def at_rest(self) -> UncertainPlant:
        """It with parameters that do not move."""
        if not self.moving:
            return self
        return replace(self, parameters=tuple(replace(p, rate=None) for p in self.parameters))

    def _read_outputs(self) -> None:
        """Leave out those of the vehicle; refuse those that do not fit, and names that repeat."""
        named = {output.name: output for output in self.outputs}
        if len(named) < len(self.outputs):
            raise PlantError("two outputs have one name; rename one")
        for output in self._of_vehicle:
            if named.pop(output.name, output) != output:
                raise PlantError(
                    f"output {output.name!r} differs from that of the vehicle, which has this "
                    "name; rename it, or leave it out"
                )
        for output in named.values():
            output.exact(self)
        for signal in (*states(self), *inputs(self)):
            if signal.name in named:
                raise PlantError(f"output {signal.name!r} is the name of a state or input; rename")
        object.__setattr__(self, "outputs", tuple(named.values()))

    @property
    def size_text(self) -> str:
        """How many vertices, states and inputs there are, in words."""
        n, m = self.shape
        counts = ((len(self.vertices), "vertex"), (n, "state"), (m, "input"))
        return ", ".join(plural(*count) for count in counts)

    def __repr__(self) -> str:
        return f"<UncertainPlant {self.name!r}: {self.size_text}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        ranges = (
            (p.name, f"{float(p.low):g} to {float(p.high):g} {p.unit}") for p in self.parameters
        )
        named = ((key, ", ".join(getattr(self, key))) for key in ("states", "inputs"))
        fitted = [("note", "" if self.data is None else self.data.note)]
        return card(self.name, [("family", self.size_text), *ranges, *named, *fitted])

    @classmethod
    @explained
    def from_vertices(
        cls, As: Sequence[Any], Bs: Sequence[Any], Es: Sequence[Any] | None = None, **names: Any
    ) -> UncertainPlant:
        """Return the polytope with these vertex matrices (nested lists, arrays, Fractions).

        Raises
        ------
        PlantError
            On ragged, empty or non-finite matrices, shapes that disagree, or B of zeros.
        """
        As, Bs = list(As), list(Bs)
        disturbances = [None] * len(As) if Es is None else list(Es)
        if not len(As) == len(Bs) == len(disturbances):
            counts = f"{len(As)} matrices A, {len(Bs)} B"
            counts += "" if Es is None else f", {len(disturbances)} E"
            raise PlantError(f"{counts}; give one of each a vertex")
        vertices = tuple(
            System(A, B, E, f"vertex {j + 1}")
            for j, (A, B, E) in enumerate(zip(As, Bs, disturbances, strict=True))
        )
        return cls(vertices, **names)

    @classmethod
    @explained
    def from_expressions(
        cls,
        parameters: Sequence[Parameter],
        A: Sequence[Sequence[Any]],
        B: Sequence[Sequence[Any]],
        E: Sequence[Sequence[Any]] | None = None,
        constants: Mapping[str, Any] | None = None,
        definitions: Mapping[str, str] | None = None,
        outputs: Mapping[str, Mapping[str, Sequence[Any]]] | None = None,
        tables: Mapping[str, Table | Surface] | None = None,
        **names: Any,
    ) -> UncertainPlant:
        """Return the family whose entries are expressions (or numbers) in the parameters.

        ``outputs`` holds for each "name [unit]" its rows ``C``, ``D`` and ``F``, as far as they are
        not zero, and ``tables`` values that expressions interpolate between. An entry that is not
        multi-affine in the scheduling variables is a polynomial on each part of the box, with what
        that is off by.

        Raises
        ------
        SpecError
            If an expression cannot be read, or a table is none.
        PlantError
            If an entry has no value somewhere in the box; the entry is named, and where that is.
        """
        scope = Scope(parameters, constants or {}, definitions or {}, tables or {})
        matrices = {"A": A, "B": B} if E is None else {"A": A, "B": B, "E": E}

        def function(**values: Any) -> dict[str, Any]:
            scope.bind(values)
            return {
                letter: [
                    [scope.entry(e, f"{letter}[{i + 1}][{j + 1}]") for j, e in enumerate(row)]
                    for i, row in enumerate(rows)
                ]
                for letter, rows in (matrices | _output_rows(outputs or {})).items()
            }

        return cls._from_symbolic(function, parameters, of_one_argument(scope.tables), **names)

    @classmethod
    @explained
    def from_function(
        cls, function: Callable[..., Any], parameters: Sequence[Parameter], **names: Any
    ) -> UncertainPlant:
        """Return the family of ``function(**parameters) -> (A, B)`` or ``(A, B, E)``.

        It may return outputs behind these, as `from_expressions` takes them. It is called with
        functions in place of numbers, so it may use ``+ - * / **`` and NumPy's ``sqrt``, ``sin``,
        ``cos``, ``exp`` and ``log`` but no branches.

        Raises
        ------
        PlantError
            If the function does something that cannot be decided exactly, or an entry has no value
            somewhere in the box; the entry is named, and where that is.
        """

        def lettered(**values: Any) -> dict[str, Any]:
            try:
                result = tuple(function(**values))
            except (TypeError, AttributeError, ValueError) as error:
                if isinstance(error, InputError):
                    raise
                if any(isinstance(value, RationalFunction) for value in values.values()):
                    return lettered(**{name: variable(name) for name in values})
                raise PlantError(
                    f"the plant function failed on symbolic parameters: {error}; it must return "
                    "A, B or A, B, E and use + - * / ** only"
                ) from error
            if len(result) not in (2, 3, 4):
                raise PlantError(
                    f"the plant function returns {len(result)} matrices; return A, B or A, B, E"
                )
            matrices = {k: M for k, M in zip("ABE", result[:3], strict=False) if M is not None}
            return matrices | _output_rows(result[3] if len(result) == 4 else {})

        return cls._from_symbolic(lettered, parameters, **names)

    @classmethod
    def _from_symbolic(
        cls,
        function: Callable[..., dict[str, Any]],
        parameters: Sequence[Parameter],
        tables: Mapping[str, Table] | None = None,
        **names: Any,
    ) -> UncertainPlant:
        parameters = (parameters,) if isinstance(parameters, Parameter) else tuple(parameters)
        count = len(parameters)
        if not 1 <= 2**count <= MAX_VERTICES:
            raise PlantError(f"{count} parameters; at most {MAX_VERTICES.bit_length() - 1}")
        values = {}
        for index, parameter in enumerate(parameters):
            s = RationalFunction.variable(index, count)
            values[parameter.name] = 1 / s if parameter.inverted else s
        with counted():
            read = Read(parameters, function, tables or {})
            table = {
                letter: read.corners(letter, rows) for letter, rows in function(**values).items()
            }
        read.require_used(table)
        placed = read.placed(table)
        order = list(itertools.product((0, 1), repeat=count))
        vertices = tuple(
            System(
                table["A"][corner],
                table["B"][corner],
                table["E"][corner] if "E" in table else None,
                f"vertex {j + 1}",
            )
            for j, corner in enumerate(order)
        )
        rows = dict[str, dict[str, Any]]()
        for where, entries in table.items():
            if where not in ("A", "B", "E"):
                label, key = where.removeprefix(OUTPUTS).rsplit(".", 1)
                rows.setdefault(label, {})[key] = [entries[corner][0] for corner in order]
        outputs = tuple(
            Output(*split(label), **keys, near=None if placed is None else placed.of_output(label))
            for label, keys in rows.items()
        )
        if placed is not None:
            names |= {"remainder": placed.remainder(), "functions": placed.functions}
        return cls(vertices, parameters, outputs=outputs, **names)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of states and inputs (n, m)."""
        return self.vertices[0].shape

    @property
    def period(self) -> Fraction:
        """The sample time [s], also of a plant in delta form; zero in continuous time."""
        return self.sample_time or self.step

    @property
    def disturbance_count(self) -> int:
        """Number of disturbances q."""
        return _width(self.vertices[0].exact_E)

    @property
    def physical(self) -> tuple[bool, ...]:
        """Whether each disturbance is one of the plant, and no noise of a sensor."""
        return tuple(signal.name not in self.noise for signal in disturbances(self))

    @cached_property
    def at_nodes(self) -> dict[tuple[Fraction, ...], Node]:
        """Matrices at points of the box: see `polefence.plant.parts.node`."""
        return {}

    @cached_property
    def on_parts(self) -> dict[tuple[tuple[Fraction, ...], ...], UncertainPlant]:
        """Families on parts of the box that were asked for, see `polefence.plant.parts`."""
        return {}

    @cached_property
    def _of_vehicle(self) -> tuple[Output, ...]:
        """Outputs of the vehicle; its description is checked against the matrices on the way."""
        return self.vehicle.outputs(self) if self.vehicle else ()

    @cached_property
    def every_output(self) -> tuple[Output, ...]:
        """Outputs, those of a vehicle first."""
        return (*self._of_vehicle, *self.outputs)

    @cached_property
    def signals(self) -> tuple[Output, ...]:
        """States, inputs and outputs."""
        return (*states(self), *inputs(self), *self.every_output)

    def signal(self, name: str) -> Output:
        """Return a state, an input or an output by its name without the unit, or what is of one.

        "rate of NAME" is of a state, "NAME without inputs" of a signal: without its D u.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        known = self.signals
        if name in [signal.name for signal in known]:
            return pick(known, name)
        of_another = without_inputs(self, name) or rate_named(self, name)
        if of_another is not None:
            return of_another
        if self.vehicle is None and name in OF_A_CAR:
            raise InputError(
                f"no signal {name!r}: cars have it by a table [vehicle], and {self.name} has none"
            )
        return pick(known, name)

    @cached_property
    def A(self) -> Array:
        """Vertex state matrices, (N, n, n)."""
        return np.stack([v.A for v in self.vertices])

    @cached_property
    def B(self) -> Array:
        """Vertex input matrices, (N, n, m)."""
        return np.stack([v.B for v in self.vertices])

    @cached_property
    def words(self) -> tuple[bytes, bytes, int]:
        """[A, B] of each vertex times their common denominator, that, and how many words each has.

        Whole numbers in two's complement, in words of 64 bits, the lowest first.
        """
        rows = [a + b for v in self.vertices for a, b in zip(v.exact_A, v.exact_B, strict=True)]
        common = common_denominator([[list(row) for row in rows]])
        whole = [e.numerator * (common // e.denominator) for row in rows for e in row]
        words = max(map(int.bit_length, (common, *whole))) // 64 + 1
        data = (e.to_bytes(8 * words, "little", signed=True) for e in whole)
        return b"".join(data), common.to_bytes(8 * words, "little", signed=True), words

    @property
    def residues(self) -> npt.NDArray[np.int64]:
        """[A, B] of each vertex times their common denominator, modulo `PRIME`, (N, n, n + m)."""
        data, _, words = self.words
        numbers = np.frombuffer(data, dtype="<u8").reshape(-1, words)
        value = (numbers[:, -1].view("<i8") % PRIME).astype(np.int64)
        for k in range(words - 2, -1, -1):
            # 2^64 = 4 modulo 2^31 - 1
            value = (4 * value + (numbers[:, k] % PRIME).astype(np.int64)) % PRIME
        return value.reshape(len(self.vertices), self.shape[0], sum(self.shape))

    @cached_property
    def surely_controllable(self) -> bool:
        """Whether residues tell that every vertex is controllable, as those of nearly all do."""
        pairs, n = self.residues, self.shape[0]
        return bool(surely_controllable(pairs[..., :n], pairs[..., n:]).all())

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the exact vertex matrices A and B, and of functions, to tell plants apart."""
        text = repr(
            [
                [[[str(e) for e in row] for row in M] for M in (v.exact_A, v.exact_B)]
                for v in self.vertices
            ]
        )
        source = self._source
        if source is not None:
            trees = [tree.text for tree in source.functions.trees]
            tables = [
                (name, [*map(str, (*t.arguments, *t.values))], t.cubic)
                for name, t in source.functions.tables
            ]
            text += repr(
                [trees, tables, [[list(map(str, x)) for x in M] for M in source.directions]]
            )
        return hashlib.sha256(text.encode()).hexdigest()

    def alpha(self, *, clamp: bool = False, **values: Any) -> Array:
        """Return the point of the simplex that belongs to physical parameter values.

        Raises
        ------
        ParameterValueError
            If a value is missing, unknown, or outside its interval (unless ``clamp``).
        """
        weights = simplex_weights(self.parameters, values, clamp)
        return np.array([float(w) for w in weights])

    @explained
    def at(self, alpha: Any) -> tuple[Array, Array]:
        """Return A(alpha), B(alpha), batched over leading axes of alpha, (..., N)."""
        weights = floats(alpha, "alpha")
        if not weights.ndim or weights.shape[-1] != len(self.vertices):
            raise InputError(
                f"alpha has shape {weights.shape}; it must end in {len(self.vertices)} weights, "
                "one per vertex"
            )
        A, B = np.tensordot(weights, self.A, 1), np.tensordot(weights, self.B, 1)
        if not self._curved:
            return A, B
        (n, m), more = self.shape, self._beyond(weights)
        return A + more[..., :n], B + more[..., n : n + m]

    def driven(self, alpha: Any) -> Array:
        """Return E(alpha), batched over leading axes of alpha; every vertex has one."""
        weights = np.asarray(alpha, dtype=float)
        E = np.tensordot(weights, np.stack([v.E for v in self.vertices if v.E is not None]), 1)
        return E + self._beyond(weights)[..., sum(self.shape) :] if self._curved else E

    @property
    def _curved(self) -> bool:
        """Whether there is more than the combination of the vertices."""
        return bool(len(self.curve)) or self._source is not None

    @property
    def _source(self) -> Source | None:
        """Which entries are functions of the parameters, on the whole box."""
        whole = self.remainder is not None and self.functions is not None
        return self.remainder.source if whole and self.remainder is not None else None

    def _beyond(self, alpha: Array) -> Array:
        """Return what is beyond the combination of the vertices: of functions what these are."""
        source = self._source
        if source is not None:
            directions = np.array(source.directions, dtype=float)
            return np.tensordot(beyond(source.functions, alpha), directions, 1)
        return np.tensordot(self.domain.basis(alpha, self.curve_degree), self.curve, 1)

    @property
    def domain(self) -> Domain:
        """The box of the parameters; of a plant without, the simplex of its vertices."""
        return Domain.of("box" if self.parameters else "simplex", len(self.vertices))

    @property
    def combinations(self) -> UncertainPlant:
        """The combinations of its vertices alone: without a remainder."""
        return self if self.remainder is None else replace(self, remainder=None, sampling=None)

    @cached_property
    def curve(self) -> Array:
        """Bernstein coefficients (count, n, n + m + q) of what is added between vertices."""
        coefficients = () if self.remainder is None else self.remainder.curve
        return np.array([[[float(x) for x in row] for row in M] for M in coefficients])

    @property
    def bent(self) -> bool:
        """Whether the smaller a part of the box is, the nearer it is to a polynomial there."""
        return self.noded or self.functions is not None

    @property
    def noded(self) -> bool:
        """Whether it is sampled between nodes, which files have."""
        return self.remainder is not None and bool(self.remainder.bends)

    @property
    def parts_degree(self) -> int:
        """The same on a part of the box."""
        return 1 if self.remainder is None else self.remainder.parts_degree

    @property
    def curve_degree(self) -> int:
        """Degree of [A, B, E] in each simplex: one without a curve."""
        return 1 if self.remainder is None else self.remainder.degree


def _output_rows(outputs: Mapping[str, Mapping[str, Sequence[Any]]]) -> dict[str, Any]:
    """Return the rows of outputs as matrices of one row, by where they stand."""
    return {
        f"{OUTPUTS}{label}.{key}": [row]
        for label, rows in outputs.items()
        for key, row in _table_of(label, rows).items()
    }


def _table_of(label: str, rows: Any) -> Mapping[str, Sequence[Any]]:
    if not isinstance(rows, Mapping):
        raise SpecError(f'outputs {shown(label)} must be a table of rows, {{"C": [1, 0]}}')
    return rows


def _common_bits(vertices: tuple[System, ...]) -> int:
    """Bits of the common denominator of A and B, as far as it is worth counting."""
    common = 1
    for vertex in vertices:
        for row in (*vertex.exact_A, *vertex.exact_B):
            common = math.lcm(common, *(entry.denominator for entry in row))
        if common.bit_length() > MAX_BITS:
            break
    return common.bit_length()


def _width(E: Exact | None) -> int:
    return 0 if E is None else len(E[0])


class Scope(Mapping[str, Any]):
    """Names of one spec: parameters, constants, and definitions evaluated when first used."""

    def __init__(
        self,
        parameters: Sequence[Parameter],
        constants: Mapping[str, Any],
        definitions: Mapping[str, str],
        tables: Mapping[str, Table | Surface] | None = None,
    ) -> None:
        self.tables = dict(tables or {})
        for name, table in self.tables.items():
            try:
                table.require(name)
            except FormatError as error:
                raise SpecError(str(error)) from error
        self.constants = {k: exact(v, f"constants.{k}") for k, v in constants.items()}
        self.definitions = dict(definitions)
        self.bound: dict[str, Any] = {}
        self.pending: list[str] = []
        names = [p.name for p in parameters]
        own = [name for name in of_one_argument(self.tables) if name not in self.tables]
        for name in [*constants, *definitions, *self.tables, *own]:
            check_name(name)
            if name in names or name in FUNCTIONS:
                raise SpecError(f"name {name!r} is given twice; rename one")
            names.append(name)
        self.names = [name for name in names if name not in {*self.tables, *own}]

    def bind(self, values: dict[str, Any]) -> None:
        """Give the parameters their symbolic values; definitions are evaluated afresh."""
        trees = any(isinstance(value, Tree) for value in values.values())
        self.one: Any = lift(1) if trees else RationalFunction.constant(Fraction(1), len(values))
        self.bound = dict(values) | {k: self.one.lift(v) for k, v in self.constants.items()}

    def bind_all(self, values: Mapping[str, Any]) -> None:
        """Give the parameters values, symbolic or not."""
        one = RationalFunction.constant(Fraction(1), len(values))
        self.bind({name: one.lift(value) for name, value in values.items()})

    def value(self, given: Any, place: str) -> Any:
        """Return an entry, as a number where it is written without any parameter."""
        entry = self.entry(given, place)
        if isinstance(entry, RationalFunction) and entry.is_constant:
            return entry([Fraction(0)] * entry.count)
        return entry

    def entry(self, given: Any, place: str) -> Any:
        """Return one matrix entry: a number as it is, an expression evaluated."""
        if not isinstance(given, str):
            return given
        try:
            return evaluate(given, self, self.one, self.tables)
        except CallError:
            return NOT_RATIONAL
        except (SpecError, PlantError) as error:
            raise type(error)(f"{place}: {error}") from error

    def __getitem__(self, name: str) -> Any:
        if name not in self.bound:
            if name not in self.definitions:
                raise SpecError(f"unknown name {shown(name)}; {suggest(name, self.names)}")
            if name in self.pending:
                raise SpecError(f"definitions go in a circle: {' -> '.join([*self.pending, name])}")
            self.pending.append(name)
            self.bound[name] = self.entry(self.definitions[name], f"definitions.{name}")
            self.pending.pop()
        if self.bound[name] is NOT_RATIONAL:
            raise CallError(f"{name} is no quotient of polynomials")
        return self.bound[name]

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Any:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)
