"""Plants as files have them: vertices and parameters, which proofs are about, and names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any, Literal

from polefence.proof.approximation import Functions
from polefence.proof.dead_time import DeadTime
from polefence.proof.entries import MAX_FUNCTIONS, Placed, read_entries, write_entries
from polefence.proof.fitted import Data
from polefence.proof.late import Late, late_in
from polefence.proof.matrices import Rationals, common_denominator
from polefence.proof.polynomials import Sizes
from polefence.proof.ranges import ANY, Range
from polefence.proof.reading import MAX_VERTICES, Table, as_number, plain, plain_rows, require_shape
from polefence.proof.remainder import MAX_CURVE, Kinks, Remainder, Rows
from polefence.proof.short import Short
from polefence.proof.work import RATIONAL, FormatError, spend

MAX_PARAMETERS = 8
RATE = "rate of "  # begins the name of a state's rate, or an input's
OF_WEIGHT = "weight state "  # begins the names of a weight's states
WITHOUT = " without inputs"  # ends that of what is left of a signal, C x + F w of C x + D u + F w


@dataclass(frozen=True)
class Output(Short):
    """y = C x + D u + F w: at every vertex C (1 x n), D (1 x m), F (1 x q) unless it is zero.

    ``near``: what [C, D, F] is off by from their combination, where functions of the parameters
    are among its entries.
    """

    C: list[Rationals]
    D: list[Rationals]
    name: str = ""
    F: tuple[Rationals, ...] = ()
    unit: str = ""
    near: Remainder | None = None

    @property
    def rows(self) -> tuple[Any, ...]:
        """What it is, whatever its name."""
        return self.C, self.D, self.F, self.near


@dataclass(frozen=True)
class Node(Short):
    """A, B and E at a point inside the box; ``at`` are weights of the parameters' upper ends."""

    at: tuple[Fraction, ...]
    A: Rationals
    B: Rationals
    E: Rationals


@dataclass(frozen=True)
class Plant(Short):
    """x' = A x + B u + E w, or x(t + sample_time) = ..., at the vertices, with names.

    ``E`` is empty where no disturbance acts. ``ranges`` has one entry a parameter, none for a plant
    given by its vertices. ``vehicle`` is plain data that no proof reads, and ``noise`` names
    disturbances. With a ``remainder`` it is only near the combinations of the vertices, or on a
    part of the box whose corners are among the ``nodes`` near what is interpolated between those.
    Where entries are ``functions`` of the parameters its remainder says which, and so do outputs.
    Where it was fitted to ``data``, these say what no proof says.
    """

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    ranges: tuple[Range, ...] = ()
    name: str = ""
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    disturbances: tuple[str, ...] = ()
    outputs: tuple[Output, ...] = ()
    sample_time: Fraction | None = None
    vehicle: Any = None
    noise: tuple[str, ...] = ()
    remainder: Remainder | None = None
    nodes: tuple[Node, ...] = ()
    functions: Functions | None = None
    data: Data | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A[0])

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.B[0][0])

    @property
    def q(self) -> int:
        """Number of disturbances."""
        return len(self.E[0][0]) if self.E else 0

    def domain(self, on: str) -> str:
        """Return where alpha lives; a box belongs to parameters that span the vertices."""
        if on == "box" and 2 ** len(self.ranges) != len(self.A):
            raise FormatError(
                f'"box" belongs to plants whose parameters span the vertices: plant.parameters '
                f"holds {len(self.ranges)}, for {len(self.A)} vertices"
            )
        return on

    @property
    def sizes(self) -> Sizes:
        """Corners of each simplex: of the box of the parameters where they span the vertices."""
        spans = 2 ** len(self.ranges) == len(self.A)
        return sizes_of(len(self.A), "box" if spans else "simplex")

    @property
    def step(self) -> Fraction:
        """The sample time, zero in continuous time."""
        return self.sample_time or Fraction(0)

    @cached_property
    def in_differences(self) -> Plant:
        """It in its delta form: A - I, B and E over the sample time; once for all claims.

        (x(t + T) - x(t)) / T = A x + B u + E w (Middleton & Goodwin, 1990), which is x' where T
        tends to zero; as it is in continuous time.
        """
        if self.sample_time is None:
            return self
        T = self.sample_time
        length = common_denominator([*self.A, *self.B, *self.E, [[T]]]).bit_length()
        entries = len(self.A) * self.n * (self.n + self.m + self.q)
        spend(RATIONAL * entries, length, length)
        A = [_difference(M, T) for M in self.A]
        B, E = ([_over(M, T) for M in matrices] for matrices in (self.B, self.E))
        remainder = self.remainder.over(T) if self.remainder else None
        common_denominator([*A, *B, *E])
        nodes = tuple(
            Node(node.at, _difference(node.A, T), _over(node.B, T), _over(node.E, T))
            for node in self.nodes
        )
        return replace(self, A=A, B=B, E=E, sample_time=None, remainder=remainder, nodes=nodes)

    @cached_property
    def late(self) -> Late | None:
        """Its dead time, None where it has none.

        Raises
        ------
        FormatError
            If it does not stand in the plant as it is said to.
        """
        return late_in(self)

    @property
    def at_rest(self) -> Plant:
        """It with parameters that do not move."""
        return replace(
            self, ranges=tuple(replace(parameter, rate=None) for parameter in self.ranges)
        )

    def require_continuous(self, what: str) -> None:
        """Refuse what is about plants in continuous time where this is none."""
        self.require_exact(what)
        if self.sample_time is not None:
            raise FormatError(f"{what}: needs a plant in continuous time")

    def require_exact(self, kind: str) -> None:
        """Refuse claims that are about the combinations of the vertices alone."""
        if self.remainder is not None:
            raise FormatError(f"{kind}: needs a plant without remainder")

    def require_noise(self, what: str) -> None:
        """Refuse a plant in discrete time, or on which no disturbance acts."""
        self.require_continuous(what)
        if not self.E:
            raise FormatError(f"{what}: the plant has no E: no disturbance acts on it")

    def signal(self, name: str) -> Output | None:
        """Return the state, input or output of a name that no other has, or what is of one."""
        zero = Fraction(0)
        known = [output for output in self.outputs if output.name == name]
        for labels, letter, count in ((self.states, "x", self.n), (self.inputs, "u", self.m)):
            names = [split(label)[0] for label in labels]
            for i, signal in enumerate(names or [f"{letter}{k + 1}" for k in range(count)]):
                if signal == name and i < count:
                    unit = [Fraction(int(i == j)) for j in range(count)]
                    C = unit if letter == "x" else [zero] * self.n
                    D = unit if letter == "u" else [zero] * self.m
                    known.append(Output([[C]] * len(self.A), [[D]] * len(self.A), name))
        if known:
            return known[0] if len(known) == 1 else None
        return self._without_inputs(name) or self._rate(name)

    def _without_inputs(self, name: str) -> Output | None:
        """Return what is left of a signal without what inputs pass straight into it."""
        whole = self.signal(name.removesuffix(WITHOUT)) if name.endswith(WITHOUT) else None
        if whole is None or whole.near is not None:
            return None
        return replace(whole, D=[[[Fraction(0)] * self.m]] * len(self.A), name=name)

    def _rate(self, name: str) -> Output | None:
        """Return the signal "rate of NAME" of a state, or of an input at samples.

        Its change in a sample over the time of one; of an input that of the state that it is a
        sample later.
        """
        names = [split(label)[0] for label in self.states]
        names = names or [f"x{i + 1}" for i in range(self.n)]
        own = name.removeprefix(RATE)
        same = [i for i, state in enumerate(names) if state == own]
        same = same or [i for i, state in enumerate(names) if state == f"{own}, 1 sample late"]
        if own == name or len(same) != 1:
            return None
        if self.remainder is not None and self.remainder.moves(same[0]):
            return None  # its change is known only near
        delta = self.in_differences
        A, B, E = ([[M[same[0]]] for M in matrices] for matrices in (delta.A, delta.B, delta.E))
        return Output(A, B, name, tuple(E) if any(any(row[0]) for row in E) else ())

    @classmethod
    def read(cls, table: Table) -> Plant:
        """Read a plant.

        Raises
        ------
        FormatError
        """
        vertices = table.tables("vertices", MAX_VERTICES)
        A = [vertex.matrix("A") for vertex in vertices]
        B = [vertex.matrix("B") for vertex in vertices]
        driven = [vertex for vertex in vertices if "E" in vertex]
        E = [vertex.matrix("E") for vertex in (vertices if driven else [])]
        n, m, q = len(A[0]), len(B[0][0]), len(E[0][0]) if E else 0
        for j in range(len(A)):
            shapes = (("A", A, n), ("B", B, m), *([("E", E, q)] if E else []))
            for letter, matrices, columns in shapes:
                require_shape(matrices[j], n, columns, f"vertex {j + 1}: {letter}")
        common_denominator([*A, *B, *E])
        plant = cls(
            A,
            B,
            E,
            _ranges(table),
            table.text("name"),
            table.texts("states"),
            table.texts("inputs"),
            table.texts("disturbances"),
            _outputs(table, (n, m, q), len(A)),
            table.number("sample_time") if "sample_time" in table else None,
            table.at("vehicle") if "vehicle" in table else None,
            table.texts("noise") if "noise" in table else (),
            _remainder(table, (n, m, q)) if "remainder" in table else None,
            _nodes(table, (n, m, q)) if "nodes" in table else (),
            data=Data.read(table.table("data")) if "data" in table else None,
        )
        if "functions" in table:
            plant = plant._with_functions(table.table("functions"))
        if "bends" in table and "kinks" in table.table("bends"):
            plant = plant._with_kinks(table.table("bends"))
        if plant.remainder is not None:
            plant.remainder.require(n, m, q, plant.sizes)
        if plant.sample_time is not None and plant.sample_time <= 0:
            raise FormatError(f"{table.path('sample_time')} must be positive")
        if plant.nodes and (plant.remainder is None or not plant.remainder.bends):
            raise FormatError(f"{table.path('nodes')}: they belong to a plant with bends")
        sampled = plant.remainder is not None and plant.remainder.source is None
        if sampled and any(parameter.rate is not None for parameter in plant.ranges):
            raise FormatError(
                f"{table.path('remainder')}: samples with one need constant parameters"
            )
        return plant

    def _with_functions(self, table: Table) -> Plant:
        """Return it with functions of the parameters among its entries."""
        if len(self.A) != 2 ** len(self.ranges):
            raise FormatError(f"{table.where}: they belong to a plant of parameters")
        names = [output.name for output in self.outputs]
        placed = read_entries(table, self.ranges, (self.n, self.m, self.q), names)
        outputs = tuple(replace(y, near=placed.of_output(y.name)) for y in self.outputs)
        remainder = placed.remainder()
        if remainder is not None and self.remainder is not None:
            raise FormatError(f"{table.where}: samples are no functions; their outputs may be")
        remainder = remainder or self.remainder
        return replace(self, outputs=outputs, remainder=remainder, functions=placed.functions)

    def _with_kinks(self, table: Table) -> Plant:
        """Return it with what functions with knots add to its samples."""
        where = table.path("kinks")
        if self.functions is None or self.remainder is None:
            raise FormatError(f"{where}: they belong to samples of functions of the parameters")
        sizes = table.matrices("kinks", self.n, self.n + self.m + self.q, MAX_FUNCTIONS)
        common_denominator(sizes)
        kinks = Kinks(self.functions, _rows(sizes))
        return replace(self, remainder=replace(self.remainder, kinks=kinks))

    def _placed(self, functions: Functions) -> dict[str, Any]:
        """Return where functions of the parameters stand, as a file has it."""
        source = self.remainder and self.remainder.source
        of_outputs = {
            y.name: y.near.source.directions
            for y in self.outputs
            if y.near is not None and y.near.source is not None
        }
        placed = Placed(functions, source.directions if source else (), of_outputs)
        return write_entries(placed, (self.n, self.m, self.q))

    def write(self) -> dict[str, Any]:
        """Return the plant as a file has it."""
        letters = zip("ABE", (self.A, self.B, self.E), strict=True)
        columns = [(key, matrices) for key, matrices in letters if matrices]
        table: dict[str, Any] = {"name": self.name}
        if self.sample_time is not None:
            table["sample_time"] = plain(self.sample_time)
        table |= {key: list(getattr(self, key)) for key in ("states", "inputs", "disturbances")}
        if self.outputs:
            table["outputs"] = [
                {"name": output.name, "unit": output.unit}
                | {key: plain_rows(getattr(output, key)) for key in "CDF" if getattr(output, key)}
                for output in self.outputs
            ]
        if self.vehicle is not None:
            table["vehicle"] = self.vehicle
        if self.noise:
            table["noise"] = list(self.noise)
        if self.data is not None:
            table["data"] = self.data.write()
        if self.functions is not None:
            table["functions"] = self._placed(self.functions)
        if self.remainder is not None and self.remainder.source is None:
            table["remainder"] = plain(self.remainder.entries)
            if self.remainder.curve:
                head = {"degree": self.remainder.degree}
                table["curve"] = head | {"coefficients": plain(self.remainder.curve)}
            if self.remainder.bends:
                head = {"rounding": plain(self.remainder.rounding)}
                table["bends"] = head | {"along": plain(self.remainder.bends)}
                if self.remainder.third:
                    table["bends"] |= {"degree": 2, "third": plain(self.remainder.third)}
                if self.remainder.kinks is not None:
                    table["bends"] |= {"kinks": plain(self.remainder.kinks.sizes)}
        table["parameters"] = [
            {
                "name": parameter.name,
                "range": plain([parameter.low, parameter.high]),
                "unit": parameter.unit,
                "through": f"1/{parameter.name}" if parameter.inverted else parameter.name,
            }
            | ({"label": parameter.label} if parameter.label else {})
            | ({} if parameter.rate is None else {"rate": _rate_text(parameter)})
            | ({} if parameter.dead_time is None else {"dead_time": parameter.dead_time.write()})
            for parameter in self.ranges
        ]
        table["vertices"] = [
            {key: plain(matrices[j]) for key, matrices in columns} for j in range(len(self.A))
        ]
        if self.nodes:
            table["nodes"] = [
                {"at": plain(node.at)}
                | {key: plain(M) for key in "ABE" if (M := getattr(node, key))}
                for node in self.nodes
            ]
        return table


def read_early(table: Table, delay: int) -> Fraction:
    """Read by how much of a period inputs act sooner than so many samples late."""
    early = table.number("early", 0)
    if not 0 <= early < 1 or (early and not delay):
        raise FormatError("early is at least 0 and below 1, and 0 where delay is 0")
    return early


def held_columns(n: int, m: int, delay: int, early: Fraction, states: int) -> list[int]:
    """Return the columns of [A, B], of so many states, by which held inputs move the first n.

    Those of the inputs that have been on their way the longest come first. Where the next ones act
    before a period ends, as the share ``early`` of it says, theirs follow.
    """
    groups = (delay, delay - 1) if early else (delay,)
    firsts = (n + (late - 1) * m if late else states for late in groups)
    return [k for first in firsts for k in range(first, first + m)]


def lattice(
    low: Sequence[Fraction], high: Sequence[Fraction], degree: int
) -> list[tuple[Fraction, ...]]:
    """Return the nodes of a part of the box: its corners, or between them too; as `corners`."""
    steps = [Fraction(k, degree) for k in range(degree + 1)]
    sides = zip(low, high, strict=True)
    return list(product(*([a + (b - a) * t for t in steps] for a, b in sides)))


def _difference(M: Rationals, T: Fraction) -> Rationals:
    return [[(a - int(i == j)) / T for j, a in enumerate(row)] for i, row in enumerate(M)]


def _over(M: Rationals, T: Fraction) -> Rationals:
    return [[x / T for x in row] for row in M]


def split(label: str) -> tuple[str, str]:
    """Return name and unit of "name [unit]"; the unit is empty where none is given."""
    name, bracket, rest = label.strip().partition("[")
    unit, closed, more = rest.partition("]")
    return (name.rstrip(), unit) if bracket and closed and not more else (label.strip(), "")


def _ranges(table: Table) -> tuple[Range, ...]:
    ranges = list[Range]()
    rows = table.tables("parameters", MAX_PARAMETERS) if table.entries.get("parameters") else []
    if "parameters" in table and not rows:
        table.items("parameters", 0, 0)
    for row in rows:
        name = row.text("name")
        through = row.text("through", name)
        if name in [known.name for known in ranges] or through not in (name, f"1/{name}"):
            raise FormatError(f"{row.where}: through must be its own name, or 1/name")
        bounds, where = row.items("range", 2, 2), row.path("range")
        low, high = (as_number(value, where) for value in bounds)
        if low >= high or (through != name and low <= 0 <= high):
            raise FormatError(f"{where} is empty, or touches zero where 1/{name} is used")
        unit, label = (row.text(key, "") for key in ("unit", "label"))
        dead_time = DeadTime.read(row.table("dead_time")) if "dead_time" in row else None
        ranges.append(Range(low, high, through != name, name, unit, label, _rate(row), dead_time))
    return tuple(ranges)


def _rate(row: Table) -> tuple[Fraction, Fraction] | Literal["any"] | None:
    if "rate" not in row or row.at("rate") == ANY:
        return ANY if "rate" in row else None
    low, high = row.numbers("rate", 2)
    if not low <= 0 <= high or low == high:
        raise FormatError(f"{row.path('rate')} must be two numbers about zero, not both zero")
    return low, high


def _rate_text(parameter: Range) -> Any:
    return parameter.rate if parameter.rate == ANY else plain(list(parameter.rate or ()))


def _outputs(table: Table, shape: tuple[int, int, int], count: int) -> tuple[Output, ...]:
    rows = table.tables("outputs", 1000) if "outputs" in table else []
    outputs = []
    for row in rows:
        C, D, F = (
            row.rows(key, width, count) if key in row else [[[Fraction(0)] * width]] * count
            for key, width in zip("CDF", shape, strict=True)
        )
        through = tuple(F) if any(any(f[0]) for f in F) else ()
        outputs.append(Output(C, D, row.text("name"), through, row.text("unit", "")))
    return tuple(outputs)


def _nodes(table: Table, shape: tuple[int, int, int]) -> tuple[Node, ...]:
    n, m, q = shape
    nodes = list[Node]()
    for row in table.tables("nodes", 10_000):
        at = row.numbers("at", len(table.items("parameters", MAX_PARAMETERS)))
        E = row.matrix("E", n, q) if q else []
        nodes.append(Node(at, row.matrix("A", n, n), row.matrix("B", n, m), E))
    places = [node.at for node in nodes]
    if len(set(places)) < len(places) or any(not 0 <= t <= 1 for at in places for t in at):
        raise FormatError(f"{table.path('nodes')}: two are at one point, or one is outside the box")
    common_denominator([M for node in nodes for M in (node.A, node.B, node.E)])
    return tuple(nodes)


def _remainder(table: Table, shape: tuple[int, int, int]) -> Remainder:
    n, m, q = shape
    rows = table.matrix("remainder", n, n + m + q)
    common_denominator([rows])
    remainder = Remainder(tuple(map(tuple, rows)))
    if "curve" in table:
        below = table.table("curve")
        degree = below.whole("degree", None, MAX_CURVE, 2)
        curve = below.matrices("coefficients", n, n + m + q)
        common_denominator(curve)
        remainder = replace(remainder, curve=_rows(curve), degree=degree)
    if "bends" in table:
        below = table.table("bends")
        rounding = below.matrix("rounding", n, n + m + q)
        bends, third = below.matrices("along", n, n + m + q, MAX_PARAMETERS), list[Rationals]()
        if below.whole("degree", 1, 2, 1) == 2:
            third = below.matrices("third", n, n + m + q, MAX_PARAMETERS)
        common_denominator([rounding, *bends, *third])
        at_nodes = tuple(map(tuple, rounding))
        remainder = replace(remainder, rounding=at_nodes, bends=_rows(bends), third=_rows(third))
    return remainder


def _rows(matrices: list[Rationals]) -> tuple[Rows, ...]:
    return tuple(tuple(map(tuple, M)) for M in matrices)


def sizes_of(count: int, on: str) -> Sizes:
    """Return the corners of each simplex: one with all vertices, or two a parameter."""
    return (count,) if on == "simplex" or count == 1 else (2,) * (count.bit_length() - 1)
