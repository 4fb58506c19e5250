"""Laws u = K(alpha) x and Lyapunov polynomials X(alpha) of their loops, as polynomials.

With W = I and Z = K for a gain, and K = Z W^-1 for a scheduled law, X is W V, so that [X; K X] is
[W; Z] V, a polynomial too: V = 1 where X is the law's own W, else Q for a gain, and for a scheduled
law multiple + Q W. The dual form needs no V: W Q (A W + B Z) is W (Q A_c) W.

A polynomial law is u = K(p) y, K the sum of gains times c^e: c the parameters' coordinates in
[-1, 1], or alpha where there are none; y = C x + F w are states, or outputs of the plant. Where
disturbances pass straight into y, those of the loop are E + B K F, and F + D K F of its outputs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product as cartesian
from typing import Any

from polefence.proof.matrices import Rationals, beside, identity, longest, mix, mixes, product
from polefence.proof.plant import Node, Plant, lattice, split
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Exponent,
    Polynomial,
    Sizes,
    affine,
    below,
    bernstein,
    constant,
    corners_of,
    count_of,
    monomials,
    restricted,
)
from polefence.proof.ranges import Range, corner_weights, corners
from polefence.proof.reading import MAX_SIZE, Table, plain, shown
from polefence.proof.remainder import Remainder, Spread
from polefence.proof.short import Short
from polefence.proof.storage import MOST_STRETCHES, Stretch
from polefence.proof.work import RATIONAL, FormatError, spend

DOMAINS = ("simplex", "box")
MAX_MEASURED = 200  # of a polynomial law
# How the names of states begin that a law keeps itself: of a dynamic one, and of a PID.
OWN = "law state ", "pid integral of ", "pid filter of "
MAX_CELLS = 1000
NO_NODE = "cells: the plant has no node where a part of the box needs one"

Point = tuple[Fraction, ...]
Lead = tuple[Fraction, Fraction]  # a and b of (s + a) / (s + b)


@dataclass(frozen=True)
class Law(Short):
    """K constant (``K`` alone); one K a corner, multi-affine between; or Z(alpha) W(alpha)^-1.

    Coefficients of W and Z are those of Bernstein polynomials: of ``degree`` in each simplex, in
    the order of `monomials`. With ``powers``, one exponent a K, it is a polynomial, of signals that
    are ``measured``: their names, and their rows C and F at every vertex, no F where none has one;
    of all states where there are none. ``anti_windup`` (n x m) times sat(u) - u is added to the
    rates of the law's own states while inputs saturate.
    """

    K: list[Rationals] | None = None
    W: list[Rationals] | None = None
    Z: list[Rationals] | None = None
    degree: int = 0
    powers: tuple[Exponent, ...] = ()
    measured: tuple[str, ...] = ()
    C: tuple[Rationals, ...] = ()
    anti_windup: Rationals | None = None
    F: tuple[Rationals, ...] = ()

    @property
    def fixed(self) -> bool:
        """Whether it is made of gains alone."""
        return self.K is not None and self.W is None and self.Z is None and not self.powers

    @property
    def polynomial(self) -> bool:
        """Whether it is a polynomial."""
        return bool(self.powers)

    @property
    def scheduled(self) -> bool:
        """Whether it is made of W and Z alone."""
        return self.K is None and self.W is not None and self.Z is not None

    def form(self, sizes: Sizes) -> Polynomial:
        """Return [I; K], or [W; Z]."""
        if self.K is None:
            pairs = zip(self.W or [], self.Z or [], strict=True)
            return bernstein([w + z for w, z in pairs], sizes, self.degree)
        if self.powers:
            gain = self._gain(sizes)
            both = below(constant(identity(gain.shape[1]), sizes), gain)
            return both.raised((max(both.degrees),) * len(sizes))
        eye = identity(len(self.K[0][0]))
        return bernstein([eye + k for k in self.K], sizes, int(len(self.K) > 1))

    @property
    def form_degree(self) -> int:
        """Degree of [I; K], or [W; Z], at most, in each simplex."""
        if self.K is None:
            return self.degree
        if not self.powers:
            return int(len(self.K) > 1)
        alpha = any(self.C[0] != C for C in self.C)
        return self.degree + int(alpha)

    def _gain(self, sizes: Sizes) -> Polynomial:
        """Return K C of a polynomial law."""
        own = self._own_gain(sizes)
        return own * affine(self.C, sizes) if self.C else own

    def passing(self, sizes: Sizes) -> Polynomial:
        """Return K F, what passes straight from the disturbances to the inputs."""
        return self._own_gain(sizes) * affine(self.F, sizes)

    def _own_gain(self, sizes: Sizes) -> Polynomial:
        """Return K of a polynomial law."""
        total: Polynomial | None = None
        for e, K in zip(self.powers, self.K or [], strict=True):
            term = constant(K, sizes)
            for j, power in enumerate(e):
                for _ in range(power):
                    term = _coordinate(sizes, j, len(e)) * term
            total = term if total is None else total + term
        if total is None:
            raise FormatError("a polynomial law has no terms")
        return total

    def gain(self, alpha: list[Fraction], at: list[Fraction]) -> Rationals:
        """Return K, of a law without W, for weights alpha and their coordinates in each simplex."""
        K = self.K or []
        if not self.powers:
            return K[0] if len(K) == 1 else mix(alpha, K)
        ends = zip(at[::2], at[1::2], strict=True) if len(self.powers[0]) != len(at) else ()
        c = [high - low for low, high in ends] or at
        values = [math.prod(map(pow, c, e), start=Fraction(1)) for e in self.powers]
        mixed = mix(values, K)
        return product(mixed, mix(alpha, list(self.C))) if self.C else mixed

    def inside(self, low: Point, high: Point) -> Law:
        """Return the same law on a part of the box, in coordinates of that part.

        c = low + high - 1 + (high - low) c' for bounds that are weights of each upper end.
        """
        if self.fixed and len(self.K or []) == 1:
            return self
        if self.scheduled:
            W, Z = (restricted(P or [], self.degree, low, high) for P in (self.W, self.Z))
            return replace(self, W=W, Z=Z)
        if not self.polynomial or len(self.powers[0]) != len(low):
            raise FormatError("cells belong to one gain, or to a law polynomial in the parameters")
        gained: dict[Exponent, Rationals] = {}
        ends = list(zip(low, high, strict=True))
        for e, K in zip(self.powers, self.K or [], strict=True):
            count, length = math.prod(power + 1 for power in e), longest((low, high)) * (sum(e) + 1)
            spend(RATIONAL * count * (len(e) + len(K) * len(K[0])), length, length)
            for exponent in cartesian(*(range(power + 1) for power in e)):
                factor = math.prod(
                    (
                        math.comb(power, i) * (a + b - 1) ** (power - i) * (b - a) ** i
                        for (a, b), power, i in zip(ends, e, exponent, strict=True)
                    ),
                    start=Fraction(1),
                )
                term = [[factor * x for x in row] for row in K]
                gained[exponent] = add(gained[exponent], term) if exponent in gained else term
        gains, powers = list(gained.values()), tuple(gained)
        C, F = (
            tuple(on_corners(list(rows), low, high)) if rows else () for rows in (self.C, self.F)
        )
        return replace(self, K=gains, degree=total_degree(powers), powers=powers, C=C, F=F)

    def write(self, on: str) -> dict[str, Any]:
        """Return it as a file has it; ``on`` is the domain of one that is not fixed."""
        if self.powers:
            pairs = zip(self.powers, self.K or [], strict=True)
            terms = [{"powers": list(e), "K": plain(K)} for e, K in pairs]
            law: dict[str, Any] = {"kind": "polynomial", "on": on, "terms": terms}
            law |= {"measured": list(self.measured)} if self.measured else {}
            gain = self.anti_windup
            return law | ({} if gain is None else {"anti_windup": plain(gain)})
        if self.K is not None:
            return {"kind": "fixed", "K": plain(self.K[0])}
        table: dict[str, Any] = {"kind": "scheduled", "W": plain(self.W), "Z": plain(self.Z)}
        table |= {"degree": self.degree} if self.degree != 1 else {}
        return table | ({"on": on} if on == "box" else {})


def read_law(table: Table, plant: Plant) -> tuple[Law, str]:
    """Read a law; return the domain of a scheduled one too, "" for a gain, which has none."""
    n, m = plant.n, plant.m
    kind = table.word("kind", ("fixed", "scheduled", "polynomial"))
    if kind == "fixed":
        return Law([table.matrix("K", m, n)]), ""
    if kind == "polynomial":
        return _read_polynomial(table, plant), table.word("on", DOMAINS)
    W, Z = table.matrices("W", n, n), table.matrices("Z", m, n)
    if len(W) != len(Z):
        raise FormatError(f"{table.path('Z')} holds {len(Z)} matrices; W holds {len(W)}")
    return Law(None, W, Z, table.whole("degree", 1)), table.word("on", DOMAINS, "simplex")


def _read_polynomial(table: Table, plant: Plant) -> Law:
    rows, measured, C, F = table.tables("terms", 500), table.texts("measured"), [], []
    none: list[Rationals] = [[[Fraction(0)] * plant.q]] * len(plant.A)
    for name in measured[:MAX_MEASURED]:
        signal = plant.signal(name)
        if signal is None or any(map(any, (D[0] for D in signal.D))) or signal.near is not None:
            raise FormatError(
                f"{table.path('measured')}: {shown(name)} is not a state or output of the plant, "
                "free of inputs, and known exactly"
            )
        C.append(signal.C)
        F.append(list(signal.F) or none)
    if len(measured) > MAX_MEASURED or len(set(measured)) < len(measured):
        raise FormatError(f"{table.path('measured')}: a name is given twice, or there are too many")
    r = len(C) if C else plant.n
    K = [row.matrix("K", plant.m, r) for row in rows]
    powers = tuple(row.wholes("powers") for row in rows)
    counts = (len(plant.A), len(plant.ranges) or len(plant.A))
    if any(len(e) not in counts for e in powers):
        raise FormatError(
            f"{table.path('terms')}: powers must be one per parameter, or one per vertex"
        )
    of_C, of_F = (
        tuple([row for (row,) in matrices] for matrices in zip(*rows, strict=True))
        for rows in (C, F)
    )
    of_F = of_F if any(map(any, (row for M in of_F for row in M))) else ()
    degree, more = total_degree(powers), _read_anti_windup(table, plant)
    return Law(K, None, None, degree, powers, measured, of_C, more, of_F)


def _read_anti_windup(table: Table, plant: Plant) -> Rationals | None:
    """Read what acts on the law's own states while inputs saturate, and on no other state."""
    if "anti_windup" not in table:
        return None
    gain = table.matrix("anti_windup", plant.n, plant.m)
    for k, row in enumerate(gain):
        name = split(plant.states[k])[0] if k < len(plant.states) else ""
        if any(row) and not name.startswith(OWN):
            raise FormatError(
                f"{table.path('anti_windup')}: row {k + 1} is of {shown(name)}, which is not a "
                "state of the law itself"
            )
        if any(row) and any(any(E[k]) for E in plant.E):
            raise FormatError(
                f"{table.path('anti_windup')}: a disturbance acts on {shown(name)}, which is thus "
                "not a state of the law itself"
            )
    return gain


def total_degree(powers: tuple[Exponent, ...]) -> int:
    """Return the largest sum of exponents."""
    return max(map(sum, powers), default=0)


def require_terms(law: Law, sizes: Sizes) -> None:
    """Refuse a polynomial law whose exponents do not fit, or whose degree is too high."""
    powers, count = law.powers, len(law.powers[0])
    if len(law.K or []) != len(powers) or len(set(powers)) < len(powers):
        raise FormatError("law.terms: each exponent belongs to one gain")
    if any(len(e) != count or min(e, default=0) < 0 for e in powers):
        raise FormatError("law.terms: powers must be whole numbers, as many in each term")
    alpha = is_alpha(law, sizes)
    if not alpha and (count != len(sizes) or set(sizes) != {2}):
        raise FormatError(f"law.terms: powers must be {len(sizes)}, one per parameter")
    if alpha and len({sum(e) for e in powers}) > 1:
        raise FormatError("law.terms: in alpha all must have one degree")
    if law.degree != total_degree(powers) or law.degree > MAX_DEGREE:
        raise FormatError(f"law.terms: the degree must be 0 to {MAX_DEGREE}")
    if law.C and len(law.C) != corners_of(sizes):
        raise FormatError("law.measured: rows are missing at a vertex")


def is_alpha(law: Law, sizes: Sizes) -> bool:
    """Whether a polynomial law is one in alpha, not in the coordinates of parameters."""
    return len(sizes) == 1 and len(law.powers[0]) == sizes[0]


def _coordinate(sizes: Sizes, j: int, count: int) -> Polynomial:
    """Return alpha_j, or the coordinate of parameter j from -1 to 1."""
    length = sum(sizes)
    if len(sizes) == 1 and count == sizes[0]:
        return Polynomial({tuple(int(i == j) for i in range(length)): [[1]]}, sizes, (1,))
    low, high = (tuple(int(i == 2 * j + k) for i in range(length)) for k in range(2))
    degrees = tuple(int(f == j) for f in range(len(sizes)))
    return Polynomial({low: [[-1]], high: [[1]]}, sizes, degrees)


@dataclass(frozen=True)
class Evidence(Short):
    """A Lyapunov polynomial, and what a method needs besides.

    ``X`` its Bernstein coefficients, or those of Q for a scheduled law (none where it is the law's
    own W, times ``multiple`` if that holds one number), ``degree`` its degree, ``elevation`` the d
    of (sum of alpha)^d; ``multiple`` (as many as X) for scheduled laws given; ``G`` and ``epsilon``
    for slack; ``tau`` for right-hand sides. ``dual``: X holds the coefficients of the Q of the dual
    form. ``spread`` is what a plant with a remainder asks for besides. ``cells``: parts of the box,
    each with evidence of its own; there is then no other. ``held``: coefficients of H X where
    inputs are cut off, which claims of that kind take over. ``pieces``: of each parameter's
    interval, in each of which the inequalities are proved. ``transfer``: the transfer function is
    the proof, and there is no other evidence. ``storage``: of what is bounded at all times of a
    period, what Q is in between.
    """

    X: list[Rationals]
    degree: int = 0
    elevation: int = 0
    multiple: tuple[Fraction, ...] = ()
    G: Rationals | None = None
    epsilon: Fraction = Fraction(0)
    tau: Fraction = Fraction(0)
    dual: bool = False
    cells: tuple[Piece, ...] = ()
    spread: Spread | None = None
    held: tuple[Rationals, ...] = ()
    held_degree: int = 0
    pieces: tuple[int, ...] = ()
    transfer: bool = False
    storage: tuple[Stretch, ...] = ()

    @property
    def per_cell(self) -> tuple[Evidence, ...]:
        """The evidence in each cell; this one where the whole box is one cell."""
        return tuple(piece.evidence for piece in self.cells) or (self,)

    @property
    def highest(self) -> int:
        """The highest degree of all cells."""
        return max(cell.degree for cell in self.per_cell)

    def require_cells(self, sizes: Sizes) -> None:
        """Refuse cells that are not in a box of these sizes, and evidence beside theirs."""
        if not self.cells:
            return
        if replace(self, cells=(), dual=False) != Evidence([]):
            raise FormatError("cells: each has evidence, and there is no other evidence")
        for piece in self.cells:
            if sizes != (2,) * len(piece.low) or piece.evidence.cells:
                raise FormatError("cells: they are parts of a box, and have none themselves")
            if piece.weights or piece.leads or piece.evidence.transfer:
                raise FormatError("cells: weights and transfer are those of opened loops alone")
            if any(not 0 <= a < b <= 1 for a, b in zip(piece.low, piece.high, strict=True)):
                raise FormatError("cells: one is empty, or not within the box")

    def write(self, letter: str = "X") -> dict[str, Any]:
        """Return the polynomial as a file has it; of the dual form the letter is Q."""
        if self.transfer:
            return {"transfer": True}
        if self.cells:
            return {"cells": [piece.write(letter) for piece in self.cells]}
        letter = "Q" if self.dual else letter
        table: dict[str, Any] = {letter: plain(self.X), "degree": self.degree}
        table |= {"multiple": plain(self.multiple)} if self.multiple else {}
        table |= {"pieces": list(self.pieces)} if self.pieces else {}
        if self.storage:
            table["storage"] = [stretch.write() for stretch in self.storage]
        if self.spread is not None:
            piece = self.spread
            keys = [key for key in ("omega", "kappa") if getattr(piece, key)]
            table["remainder"] = {
                key: plain(getattr(piece, key)) for key in (*keys, "rows", "columns")
            }
        return table | {"elevation": self.elevation}


@dataclass(frozen=True)
class Piece(Short):
    """A part of the box of the parameters, with evidence for it.

    ``low`` and ``high`` are weights of each parameter's upper end, from 0 to 1. ``weights`` and
    ``leads`` are the scale of opened loops in this part alone, where it has one of its own.
    """

    low: Point
    high: Point
    evidence: Evidence
    weights: tuple[Fraction, ...] = ()
    leads: tuple[Lead, ...] = ()

    def write(self, letter: str) -> dict[str, Any]:
        """Return it as a file has it."""
        table: dict[str, Any] = {"low": plain(self.low), "high": plain(self.high)}
        table |= {"weights": plain(self.weights)} if self.weights else {}
        return table | write_leads(self.leads) | self.evidence.write(letter)

    @property
    def volume(self) -> Fraction:
        """Share of the box."""
        sides = (b - a for a, b in zip(self.low, self.high, strict=True))
        return math.prod(sides, start=Fraction(1))


def require_continuous(cells: Sequence[Piece], ranges: Sequence[Range]) -> None:
    """Refuse parts of the box whose X differ where a moving parameter goes from one to another.

    The parts are cells of a grid: two that touch across a moving parameter have the same ends
    along all others. X, or Q, is then continuous along every motion, and its change is that in the
    parts.
    """
    known: dict[tuple[Point, Point], Evidence] = {(p.low, p.high): p.evidence for p in cells}
    for piece in cells:
        for f, parameter in enumerate(ranges):
            if parameter.rate is None or piece.high[f] == 1:
                continue
            beyond = [high for low, high in known if low == _moved_to(piece.low, f, piece.high[f])]
            others = [high for high in beyond if _moved_to(high, f, piece.high[f]) == piece.high]
            if len(others) != 1:
                raise FormatError("cells: while parameters move they must be those of a grid")
            other = known[_moved_to(piece.low, f, piece.high[f]), others[0]]
            if _face(piece.evidence, f, 1, len(ranges)) != _face(other, f, 0, len(ranges)):
                raise FormatError("cells: X or Q is not continuous where parameters move")


def _moved_to(point: Point, f: int, value: Fraction) -> Point:
    return (*point[:f], value, *point[f + 1 :])


def _face(evidence: Evidence, f: int, side: int, count: int) -> tuple[int, list[Rationals]]:
    """Return the coefficients of X where parameter f is at an end."""
    exponents = monomials((2,) * count, evidence.degree)
    whole = evidence.degree
    pairs = zip(exponents, evidence.X, strict=True)
    return whole, [X for e, X in pairs if e[2 * f + side] == whole]


def on_corners(vertices: list[Rationals], low: Point, high: Point) -> list[Rationals]:
    """Return what is multi-affine on the box at the corners of a part of it."""
    length = longest((low, high)) * len(low)
    spend(RATIONAL * len(vertices) ** 2 * len(low), length, length)
    return mixes([corner_weights(corner) for corner in corners(low, high)], vertices)


def on_part(
    vertices: Sequence[list[Rationals]],
    nodes: Sequence[Node],
    remainder: Remainder | None,
    low: Point,
    high: Point,
) -> tuple[list[list[Rationals]], Remainder | None]:
    """Return A, B and E at the corners of a part of the box, and the remainder there.

    Where nodes are they are sampled at these.
    """
    if remainder is None or not remainder.bends:
        at_corners = [on_corners(matrices, low, high) if matrices else [] for matrices in vertices]
        if remainder is None:
            return at_corners, None
        widths = [len(matrices[0][0]) if matrices else 0 for matrices in vertices]
        for k, more in enumerate(remainder.added(low, high, widths)):
            at_corners[k] = list(map(add, at_corners[k], more))
        return at_corners, remainder.inside(low, high)
    degree = remainder.parts_degree
    values = at_nodes(vertices, nodes, lattice(low, high, degree))
    if degree == 1:
        return values, remainder.inside(low, high)
    whole = [beside(matrices) for matrices in zip(*filter(None, values), strict=True)]
    ends = [k for k, at in enumerate(cartesian(range(3), repeat=len(low))) if 1 not in at]
    return (
        [[matrices[k] for k in ends] if matrices else [] for matrices in values],
        remainder.inside(low, high, whole),
    )


def inner_points(evidence: Iterable[Evidence], remainder: Remainder | None) -> list[Point]:
    """Return the nodes of all cells that are not corners of the box, in order."""
    degree = remainder.parts_degree if remainder is not None and remainder.bends else 1
    pieces = [piece for proof in evidence for piece in proof.cells]
    for piece in pieces:
        spend(4 * len(piece.low) * (degree + 1) ** len(piece.low), 64)
    places = {point for piece in pieces for point in lattice(piece.low, piece.high, degree)}
    return sorted(point for point in places if set(point) - {0, 1})


def used_nodes(plant: Plant, evidence: Iterable[Evidence]) -> tuple[Node, ...]:
    """Return the nodes of cells, of a plant that has some.

    Raises
    ------
    FormatError
        If one is missing.
    """
    if plant.remainder is None or not plant.remainder.bends:
        return ()
    known, nodes = {node.at: node for node in plant.nodes}, list[Node]()
    for point in inner_points(evidence, plant.remainder):
        if point not in known:
            raise FormatError(NO_NODE)
        nodes.append(known[point])
    return tuple(nodes)


def at_nodes(
    vertices: Sequence[list[Rationals]], nodes: Sequence[Node], points: Sequence[Point]
) -> list[list[Rationals]]:
    """Return A, B and E at points of the box: of vertices, or of nodes."""
    spend(RATIONAL * (len(nodes) + len(points)) * len(points[0]), 0)
    known = {node.at: [node.A, node.B, node.E] for node in nodes}
    gathered: list[list[Rationals]] = [[] for _ in vertices]
    for point in points:
        if point in known:
            there = list(known[point])
        elif set(point) <= {0, 1}:
            number = int("".join(str(t) for t in point), 2)
            there = [M[number] if M else [] for M in vertices]
        else:
            raise FormatError(NO_NODE)
        for matrices, M in zip(gathered, there, strict=False):
            matrices.append(M)
    return [matrices if source else [] for matrices, source in zip(gathered, vertices, strict=True)]


def add(one: Rationals, other: Rationals) -> Rationals:
    """Return the sum of two matrices."""
    pairs = zip(one, other, strict=True)
    return [[a + b for a, b in zip(*rows, strict=True)] for rows in pairs]


def read_cells(
    table: Table, n: int, sizes: Sizes, dual: bool = False, multiple: bool = False
) -> Evidence:
    """Read evidence of parts of the box."""
    pieces = []
    for row in table.tables("cells", MAX_CELLS):
        low, high = (row.numbers(key, len(sizes)) for key in ("low", "high"))
        weights = row.numbers("weights", most=MAX_MEASURED) if "weights" in row else ()
        leads = read_leads(row, len(weights))
        if weights and "transfer" in row:
            pieces.append(Piece(low, high, Evidence([], transfer=True), weights, leads))
            continue
        own, letter = n + 2 * sum(zero != pole for zero, pole in leads), "Q" if dual else "X"
        letter = "Q" if weights and "Q" in row else letter
        evidence = read_evidence(row, own, sizes, letter, multiple=multiple)
        pieces.append(Piece(low, high, replace(evidence, dual=letter == "Q"), weights, leads))
    return Evidence([], dual=dual, cells=tuple(pieces))


def read_leads(table: Table, count: int) -> tuple[Lead, ...]:
    """Return the leads of so many loops, none where the file has none."""
    if "zeros" not in table and "poles" not in table:
        return ()
    zeros, poles = (table.numbers(key, count) for key in ("zeros", "poles"))
    return tuple(zip(zeros, poles, strict=True))


def write_leads(leads: Sequence[Lead]) -> dict[str, Any]:
    """Return what `read_leads` reads."""
    keys = ("zeros", "poles") if leads else ()
    return {key: plain([lead[k] for lead in leads]) for k, key in enumerate(keys)}


def read_evidence(
    table: Table, n: int, sizes: Sizes, letter: str = "X", degree: int = 0, multiple: bool = False
) -> Evidence:
    """Read a Lyapunov polynomial, of this degree where the file does not say.

    ``multiple`` is whether multiples belong to it.
    """
    X = table.matrices(letter, n, n)
    degree = table.whole("degree", degree)
    if len(X) != count_of(sizes, degree):
        raise FormatError(
            f"{table.path(letter)} holds {len(X)} matrices; its degree needs "
            f"{count_of(sizes, degree)}"
        )
    values: tuple[Fraction, ...] = ()
    if multiple and "multiple" in table:
        values = table.numbers("multiple", most=len(X))
        if len(values) != len(X):
            raise FormatError(f"{table.path('multiple')} must hold one number a matrix")
    spread = None
    if "remainder" in table:
        below = table.table("remainder")
        omega = below.matrix("omega", n, n) if "omega" in below else []
        kappa = below.number("kappa", 0)
        rows, columns = below.numbers("rows", n), below.numbers("columns", most=3 * MAX_SIZE)
        spread = Spread(omega, rows, columns, kappa)
    pieces = table.wholes("pieces", MAX_CELLS) if "pieces" in table else ()
    known = Evidence(X, degree, table.whole("elevation", 0), values, spread=spread, pieces=pieces)
    if "storage" not in table:
        return known
    stretches = table.tables("storage", MOST_STRETCHES)
    return replace(known, storage=tuple(Stretch.read(one, sizes) for one in stretches))


def lifted(law: Law, evidence: Evidence, sizes: Sizes) -> Polynomial:
    """Return [X; K X]."""
    form = law.form(sizes)
    if not evidence.X:
        return form.times(evidence.multiple[0] if evidence.multiple else 1)
    V = bernstein(evidence.X, sizes, evidence.degree)
    if law.K is None:
        n = form.shape[1]
        V = V * form.part(slice(n))
        if evidence.multiple:
            eye = identity(n)
            multiples = [[[m * x for x in row] for row in eye] for m in evidence.multiple]
            V = V + bernstein(multiples, sizes, evidence.degree)
    return form * V


def degree_of(law: Law, evidence: Evidence) -> int:
    """Return the degree of [X; K X]."""
    if law.K is not None:
        return evidence.degree + law.form_degree
    return evidence.degree + 2 * law.degree if evidence.X else law.degree
