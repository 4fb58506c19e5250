"""Sectors: static elements that no model has, each between a signal and a disturbance.

An element gives w = phi(t, y), y = C x + D u a signal of the plant and w one of its disturbances,
phi any function whose graph is in a sector: between a y and b y at every time, also one that varies
in time. With the centre c = (a + b) / 2 and the radius r = (b - a) / 2 of each,

    w = c y + z,    |z| <= r |y|:

the centres are fed back, x' = (A + E c C) x + (B + E c D) u + E z, and so they are into what the
law measures, y_m = (C_m + F_m c C) x + F_m z. By the circle criterion (Zames, IEEE Transactions on
Automatic Control 11(2), 1966) that loop stays stable for all elements if the gain from d^-1 z to
d r y is less than one for some positive d of each: of x'P x, which shows it, the derivative is
negative along every motion, whatever phi is.

Where the gain is less than ``level`` the radii may be 1 / level times as large.

Of phi(y) that does not depend on time more is proved, by Popov's criterion (Popov, Automation and
Remote Control 22, 1961; Khalil, Nonlinear Systems, 3rd ed., section 7.1.2). For y' that no z
enters, a number p of each, rho = r / level and P = |p|, z = zt + p y' is fed back, and the gain
from d^-1 zt to d (r y + level P y') is proved to be below ``level``, by some x'Q x. For p >= 0

    |zt|^2 - |rho y + p y'|^2  =  z^2 - rho^2 y^2 - 2 p y'(z + rho y),

and for p < 0 the same with P, z and y' of the other sign. So of

    V = x'Q x + 2 sum d^2 P int_0^y (rho s + sign(p) z(s)) ds,

in which no integral is negative, nor more than a constant times y^2, the derivative is at most that
of x'Q x less the supply, and d^2 (z^2 - rho^2 y^2), which is not positive: it falls as |x|^2 does.
Parameters may move, for C, c and r are constant.

Of phi(y) whose slope is in the sector too, between any two points, more is proved by a multiplier
of Zames and Falb (SIAM Journal on Control 6(1), 1968) of first order. Then rho y + z and rho y - z
do not fall as y grows. So of one of them, f, and the other, g, the integral of f (g - h * g) is not
negative from zero to any time, for h(t) = 2 |b| exp(-(a + |b|) t), whose integral is at most one
for |b| <= a: of two signals that rise and fall together the integral of the product is largest
where neither is delayed.
With f = rho y - z for b > 0, f = rho y + z for b < 0, and s the sign of b, that integral is of
yt^2 - zt^2 with

    l' = -a l + b rho y + |b| zt,    z = l + zt,    yt = rho y - s l,

and l = 0 at the time from which it is taken. So the loop with z = l + zt fed back, of one state
more for each such element, is proved to have a gain below one from d^-1 zt to d yt. Of every motion
from x, the integral of |x(t)|^2 is then at most a constant times |x|^2, and x falls as
exponentially as that says. Here rows of y may depend on parameters, and z may enter y'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, require_law
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.samples import Samples
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    Subject,
    misnamed,
    outputs_text,
    read_outputs,
    read_subject,
    write_evidence,
    write_outputs,
)
from polefence.proof.filters import widened
from polefence.proof.laws import Law, add
from polefence.proof.matrices import ONE, ZERO, Rationals, beside, product
from polefence.proof.plant import Output, Plant, split
from polefence.proof.reading import Table, plain
from polefence.proof.remainder import Remainder, Rows
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up, number_text, quoted
from polefence.proof.work import RATIONAL, FormatError, spend

Sector = tuple[Fraction, Fraction]
Lag = tuple[Fraction, Fraction]
MAX_WIDTH = 1000  # disturbances of a plant
VARYING = (
    "where an element acts (E) and its signal both depend on parameters, so that their product is "
    "not affine; take a signal of constant rows"
)


@dataclass(frozen=True)
class Elements(Short):
    """Elements w = phi(t, y) of a plant, and how each is weighed.

    Attributes
    ----------
    signals : tuple of Output
        The y of each, of the plant.
    disturbances : tuple of int
        The number of the w of each, from 0.
    sectors : tuple of (Fraction, Fraction)
        a and b of each.
    weights : tuple of Fraction
        d of each.
    multipliers : tuple of Fraction
        p of each; none where all are zero.
    lags : tuple of (Fraction, Fraction)
        a and b of each, zero where it has none; none where all are.
    """

    signals: tuple[Output, ...]
    disturbances: tuple[int, ...]
    sectors: tuple[Sector, ...]
    weights: tuple[Fraction, ...]
    multipliers: tuple[Fraction, ...] = ()
    lags: tuple[Lag, ...] = ()

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.signals)

    @property
    def alike(self) -> Self:
        """They with weights of one, and no multipliers."""
        return replace(self, weights=(ONE,) * self.count, multipliers=(), lags=())

    @property
    def centres(self) -> Rationals:
        """The diagonal matrix of c."""
        middles = [(a + b) / 2 for a, b in self.sectors]
        return [[c * (i == j) for j in range(self.count)] for i, c in enumerate(middles)]

    @property
    def radii(self) -> tuple[Fraction, ...]:
        """R of each."""
        return tuple((b - a) / 2 for a, b in self.sectors)

    def widened(self, level: Fraction) -> tuple[Sector, ...]:
        """Return the sectors with radii 1 / level times as large."""
        pairs = zip(self.sectors, self.radii, strict=True)
        return tuple(((a + b) / 2 - r / level, (a + b) / 2 + r / level) for (a, b), r in pairs)

    def require(self, n: int, m: int, q: int) -> None:
        """Refuse elements that a plant of n states, m inputs and q disturbances has not.

        Raises
        ------
        FormatError
        """
        if not 1 <= self.count <= MAX_ENTRIES:
            raise FormatError(f"outputs: elements are 1 to {MAX_ENTRIES}")
        numbers = self.disturbances
        for key, values in (
            ("disturbances", numbers),
            ("sectors", self.sectors),
            ("weights", self.weights),
            ("multipliers", self.multipliers or self.weights),
            ("lags", self.lags or self.weights),
        ):
            if len(values) != self.count:
                raise FormatError(f"{key} must hold {self.count} entries, one an element")
        if len(set(numbers)) < self.count or not all(0 <= k < q for k in numbers):
            raise FormatError(f"disturbances must be different numbers from 1 to {q}")
        if min(self.weights) <= 0:
            raise FormatError(f"weights must be {self.count} positive numbers, one an element")
        for signal in self.signals:
            if any(
                len(C[0]) != n or len(D[0]) != m for C, D in zip(signal.C, signal.D, strict=True)
            ):
                raise FormatError("outputs: a row does not fit the plant")
            if signal.near is not None:
                raise FormatError(
                    f"{quoted(signal.name)} is a function of the parameters; an element is of a "
                    "signal that is known exactly"
                )
            if any(row[k] for (row,) in signal.F for k in numbers):
                raise FormatError(
                    f"the force of an element passes straight into {quoted(signal.name)}, which "
                    "it depends on; take another signal, or one behind a filter"
                )

    def of(self, matrices: Sequence[Rationals]) -> list[Rationals]:
        """Return the columns of their disturbances, of E or of F at every vertex."""
        return [[[row[k] for k in self.disturbances] for row in M] for M in matrices]

    def rows(self, key: str) -> list[Rationals]:
        """Return C, or D, of their signals, one below the other, at every vertex."""
        stacks = zip(*(getattr(signal, key) for signal in self.signals), strict=True)
        return [[row for rows in stack for row in rows] for stack in stacks]

    def plant(self, plant: Plant) -> Plant:
        """Return the plant with the centres fed back, on which the elements alone act.

        Raises
        ------
        FormatError
            If it is none that is known so.
        """
        q = plant.q
        if not plant.E:
            raise FormatError("the plant has no E: no element acts on it")
        self.require(plant.n, plant.m, q)
        E = self.of(plant.E)
        A, B = self.fed_back((plant.A, plant.B), E)
        return replace(
            plant,
            A=A,
            B=B,
            E=E,
            disturbances=(),
            outputs=(),
            noise=(),
            remainder=self.remainder(plant.remainder, plant.n, plant.m),
            nodes=(),
        )

    def fed_back(
        self, matrices: tuple[list[Rationals], list[Rationals]], E: list[Rationals]
    ) -> tuple[list[Rationals], list[Rationals]]:
        """Return A + E c C and B + E c D, or the same of what a law measures."""
        A, B = (
            [
                add(M, more)
                for M, more in zip(known, times(E, self.centres, self.rows(key)), strict=True)
            ]
            for known, key in zip(matrices, "CD", strict=True)
        )
        return A, B

    def remainder(self, known: Remainder | None, n: int, m: int) -> Remainder | None:
        """Return what [A, B, E] is beyond the combination of the vertices, centres fed back.

        Raises
        ------
        FormatError
        """
        if known is None:
            return None
        if known.source is None:
            raise FormatError("a plant that is known only nearly has no elements")
        entering = [n + m + k for k in self.disturbances]
        moved = any(row[k] for M in known.source.directions for row in M for k in entering)
        rows = [beside(pair) for pair in zip(self.rows("C"), self.rows("D"), strict=True)]
        if moved and _varies(rows):
            raise FormatError(VARYING)
        fed = product(self.centres, rows[0])

        def changed(M: Rows) -> Rows:
            E = [[row[k] for k in entering] for row in M]
            heads = add([list(row[: n + m]) for row in M], product(E, fed))
            return tuple((*head, *tail) for head, tail in zip(heads, E, strict=True))

        directions = tuple(map(changed, known.source.directions))
        return replace(known.source, directions=directions).on_box

    def law(self, law: Law) -> Law:
        """Return a law into whose signals the centres are fed back, and the elements pass.

        Raises
        ------
        FormatError
        """
        if not law.F:
            return law
        F = self.of(law.F)
        if not any(any(map(any, M)) for M in F):
            return replace(law, F=())
        D = self.rows("D")
        if any(any(map(any, M)) for M in D):
            raise FormatError(
                "the force of an element passes straight into what the law measures, and the law "
                "into the element's signal; take another signal"
            )
        none = [[[ZERO] * len(D[0][0]) for _ in M] for M in F]
        C, _ = self.fed_back((list(law.C), none), F)
        return replace(law, C=tuple(C), F=tuple(F))

    # --- multipliers: of a plant and a law with the centres fed back -----------------------------

    @property
    def led(self) -> list[int]:
        """Numbers of those whose multipliers are not zero."""
        return [k for k, p in enumerate(self.multipliers) if p]

    @property
    def lagging(self) -> list[int]:
        """Numbers of those that have lags."""
        return [k for k, (_, b) in enumerate(self.lags) if b]

    def require_multipliers(self, subject: Subject) -> None:
        """Refuse multipliers of signals whose rates an element enters, or that are not known.

        Raises
        ------
        FormatError
            Saying of which, and why.
        """
        if (self.led or self.lagging) and subject.step:
            raise FormatError("multipliers, lags: in discrete time there are none")
        for k, (a, b) in enumerate(self.lags):
            if b and self.multipliers and self.multipliers[k]:
                raise FormatError("multipliers, lags: an element has one or the other")
            if abs(b) > a:
                raise FormatError("lags must be pairs [a, b], b from -a to a")
        for k in self.led:
            why = self._beyond(k, subject)
            if why:
                raise FormatError(f"multipliers: {quoted(self.signals[k].name)} {why}")

    def _beyond(self, k: int, subject: Subject) -> str:
        """Say why an element has no multiplier; "" where it may have one."""
        y, rest = self.signals[k], subject.remainder
        (C,) = y.C[0]
        if _varies(y.C) or any(any(row) for (row,) in y.D):
            return "depends on parameters, or on inputs"
        seen = [i for i, x in enumerate(C) if x]
        if any(any(product([C], E)[0]) for E in subject.E):
            return "has a rate that an element enters"
        if rest is not None and any(any(row) for i in seen for row in rest.rows_of(i)):
            return "has a rate that is a function of the parameters"
        A, B = self._rates(k, subject)
        if subject.law.F and any(map(any, B)):
            return "has a rate into which the law passes an element"
        columns = [[row[k] for row in E] for E in subject.E]
        passed = [[row[k] for row in F] for F in subject.law.F]
        off = rest is not None and any(
            row[subject.n + subject.m + k] for i in range(subject.n) for row in rest.rows_of(i)
        )
        if (_varies(A) or _varies(B)) and (_varies(columns) or _varies(passed) or off):
            return "has a rate, and an effect, that both depend on parameters"
        return ""

    def _rates(self, k: int, subject: Subject) -> tuple[Rationals, Rationals]:
        """Return the rows of y' = C A x + C B u of one at every vertex."""
        (C,) = self.signals[k].C[0]
        A, B = ([product([C], M)[0] for M in rows] for rows in (subject.A, subject.B))
        return A, B

    def with_rates(self, subject: Subject) -> Subject:
        """Return the loop with p y' fed back; it has the same y'.

        Raises
        ------
        FormatError
            As `require_multipliers`.
        """
        self.require_multipliers(subject)
        A, B, law, rest = list(subject.A), list(subject.B), subject.law, subject.remainder
        for k in self.led:
            p, (of_A, of_B) = self.multipliers[k], self._rates(k, subject)
            A, B = _plus(A, subject.E, of_A, p, k), _plus(B, subject.E, of_B, p, k)
            if law.F:
                law = replace(law, C=tuple(_plus(law.C, law.F, of_A, p, k)))
            if rest is not None and rest.source is not None:
                rate, entering = [*of_A[0], *of_B[0]], subject.n + subject.m + k
                directions = tuple(_directed(M, entering, p, rate) for M in rest.source.directions)
                rest = replace(rest.source, directions=directions).on_box
        return replace(subject, A=A, B=B, law=law, remainder=rest)

    def with_lags(self, level: Fraction, subject: Subject) -> Subject:
        """Return the loop with l fed back, of one state more for each that has a lag."""
        lagging, n, m, rest = self.lagging, subject.n, subject.m, subject.remainder
        if not lagging:
            return subject
        if level <= 0:
            raise FormatError("level must be positive")
        size, more = n + len(lagging), len(lagging)
        spend(RATIONAL * len(subject.A) * size * (size + m + subject.q), 64, 64)

        def wider(M: Sequence[Sequence[Fraction]], first: int, at: int) -> Rationals:
            """Return rows of [..., w], w from ``first`` on, with l after the column ``at``."""
            return [
                [*row[:at], *(row[first + k] for k in lagging), *row[at:]] for row in map(list, M)
            ]

        A, B, E = [], [], []
        for j, (of_x, of_u, of_z) in enumerate(zip(subject.A, subject.B, subject.E, strict=True)):
            rows = [[*x, *z] for x, z in zip(of_x, of_z, strict=True)]
            A.append([row[:size] for row in wider(rows, n, n)])
            B.append([*map(list, of_u)])
            E.append([*map(list, of_z)])
            for i, k in enumerate(lagging):
                (a, b), y = self.lags[k], self.signals[k]
                share = b * self.radii[k] / level
                own = [-a * (i == other) for other in range(more)]
                A[-1].append([*(share * x for x in y.C[j][0]), *own])
                B[-1].append([share * x for x in y.D[j][0]])
                E[-1].append([abs(b) * (k == other) for other in range(subject.q)])

        def taller(M: Rows) -> Rows:
            rows = [tuple(row) for row in wider(M, n + m, n)]
            return (*rows, *((ZERO,) * (size + m + subject.q) for _ in lagging))

        law = widened(subject.law, n, more)
        if law.F:
            pairs = zip(subject.law.C, law.F, strict=True)
            C = ([[*c, *f] for c, f in zip(*pair, strict=True)] for pair in pairs)
            law = replace(law, C=tuple([row[:size] for row in wider(M, n, n)] for M in C))
        return replace(subject, A=A, B=B, E=E, law=law, remainder=rest and rest.mapped(taller))

    def outputs(self) -> tuple[Output, ...]:
        """Return d r y of each."""
        outputs = list[Output]()
        for y, r, d in zip(self.signals, self.radii, self.weights, strict=True):
            C, D = ([[[d * r * x for x in M[0]]] for M in rows] for rows in (y.C, y.D))
            outputs.append(Output(C, D))
        return tuple(outputs)

    def rated(self, level: Fraction, subject: Subject) -> tuple[Output, ...]:
        """Return d (r y + level |p| y') of each, or d (r y - s level l)."""
        outputs, more = list(self.outputs()), len(self.lagging)
        for k in self.led:
            size = self.weights[k] * level * abs(self.multipliers[k])
            C, D = (
                [[[x + size * v for x, v in zip(M[0], rate, strict=True)]] for M, rate in pairs]
                for pairs in (
                    zip(rows, rates, strict=True)
                    for rows, rates in zip(
                        (outputs[k].C, outputs[k].D), self._rates(k, subject), strict=True
                    )
                )
            )
            outputs[k] = Output(C, D)
        for k, y in enumerate(outputs if more else ()):
            own = [level * self.weights[k] * (-1 if self.lags[k][1] > 0 else 1)]
            last = [x * (k == other) for other in self.lagging for x in own]
            outputs[k] = Output([[[*C[0], *last]] for C in y.C], y.D)
        return tuple(outputs)

    @property
    def scales(self) -> tuple[Fraction, ...]:
        """How many times each z acts."""
        return tuple(1 / d for d in self.weights)


def times(E: list[Rationals], c: Rationals, C: list[Rationals]) -> list[Rationals]:
    """Return E c C at every vertex, of which it is the combination between them too.

    Raises
    ------
    FormatError
        If it is not: where an entry of E and one of C that are multiplied both vary.
    """
    moved = [product(left, c) for left in E]
    for k in range(len(c)):
        one, other = (
            _varies([[row[k] for row in M] for M in moved]),
            _varies([M[k] for M in C]),
        )
        if one and other:
            raise FormatError(VARYING)
    return [product(left, right) for left, right in zip(moved, C, strict=True)]


def _varies(rows: Sequence[Sequence[Any]]) -> bool:
    return any(row != rows[0] for row in rows)


def _plus(
    matrices: Sequence[Rationals], E: Sequence[Rationals], rates: Rationals, p: Fraction, k: int
) -> list[Rationals]:
    """Return M + p E rate at every vertex, of the k-th column of E."""
    return [
        [[x + p * e[k] * v for x, v in zip(old, rate, strict=True)] for old, e in rows]
        for rows, rate in zip(
            (zip(M, own, strict=True) for M, own in zip(matrices, E, strict=True)),
            rates,
            strict=True,
        )
    ]


def _directed(M: Rows, entering: int, p: Fraction, row: Sequence[Fraction]) -> Rows:
    """Return the direction of a function in [A, B, E] with p E row in its first columns."""
    count = len(row)
    return tuple(
        (*(x + p * own[entering] * v for x, v in zip(own, row, strict=False)), *own[count:])
        for own in M
    )


@dataclass(frozen=True)
class SectorBound(Gain):
    """The loop is stable for all elements in sectors; ``level`` is 1 over what widens them.

    The subject is the loop with the centres fed back, and the outputs are d r y.
    """

    kind: ClassVar[str] = "sector"
    late_as: ClassVar[str | None] = None

    elements: Elements = field(kw_only=True)
    invariant: bool = field(default=False, kw_only=True)  # whether phi does not depend on time
    restricted: bool = field(default=False, kw_only=True)  # and its slope is in the sector too

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read signals, disturbances, sectors and weights of the elements, level and evidence."""
        law = require_law(law, cls.kind)
        signals = read_outputs(table, plant, MAX_ENTRIES)
        rows = table.matrix("sectors", len(signals), 2)
        lags = table.matrix("lags", len(signals), 2) if "lags" in table else []
        elements = Elements(
            signals,
            read_numbers(table),
            tuple((a, b) for a, b in rows),
            table.numbers("weights"),
            table.numbers("multipliers") if "multipliers" in table else (),
            tuple((a, b) for a, b in lags),
        )
        changed, beside_it = elements.plant(plant), elements.law(law)
        subject = read_subject(table.table("evidence"), changed, beside_it, on)
        flags = {key: table.flag(key) for key in ("invariant", "restricted")}
        return cls.of(subject, elements, table.number("level"), **flags)

    @classmethod
    def of(
        cls,
        subject: Subject,
        elements: Elements,
        level: Fraction,
        *,
        invariant: bool = False,
        restricted: bool = False,
    ) -> Self:
        """Return the claim about a loop whose centres are fed back."""
        known: dict[str, Any] = {"scales": elements.scales, "elements": elements}
        known |= {"invariant": invariant, "restricted": restricted}
        return cls(subject, elements.outputs(), level, **known)

    @property
    def bare(self) -> Self:
        """What is claimed: weights and multipliers are a part of what proves it."""
        subject, alike = super().bare.subject, self.elements.alike
        flags = {"invariant": self.invariant, "restricted": self.restricted}
        return self.of(subject, alike, self.level, **flags)

    @property
    def filtered(self) -> bool:
        """Whether the evidence is of another loop than the subject."""
        return bool(self.elements.led or self.elements.lagging)

    @property
    def series(self) -> Self:
        """The same claim about the loop with p y', or l, fed back: it has no multipliers."""
        if not self.filtered:
            return self
        elements = self.elements
        outputs = elements.rated(self.level, self.subject)
        subject = elements.with_lags(self.level, elements.with_rates(self.subject))
        none = replace(elements, multipliers=(), lags=())
        return replace(self, subject=subject, outputs=outputs, elements=none)

    def require(self) -> None:
        """Refuse multipliers that do not fit; then as any other claim."""
        if self.elements.multipliers and not self.invariant:
            raise FormatError("multipliers: they are for what does not vary in time; say invariant")
        if self.restricted and not self.invariant:
            raise FormatError("restricted: it is of what does not vary in time; say invariant")
        if self.elements.lags and not self.restricted:
            raise FormatError("lags: they are for slopes in the sectors; say restricted")
        self.elements.require_multipliers(self.subject)
        super().require()

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        elements = self.elements
        table: dict[str, Any] = {"kind": self.kind} | write_outputs(elements.signals)
        table["disturbances"] = [k + 1 for k in elements.disturbances]
        table["sectors"] = plain([list(pair) for pair in elements.sectors])
        table |= {"invariant": True} if self.invariant else {}
        table |= {"restricted": True} if self.restricted else {}
        table |= {"weights": plain(elements.weights)}
        table |= {"multipliers": plain(elements.multipliers)} if elements.multipliers else {}
        table |= {"lags": plain([list(pair) for pair in elements.lags])} if elements.lags else {}
        table |= {"level": plain(self.level)}
        return table | {"evidence": write_evidence(self.subject)}

    def require_extra(self) -> None:
        """Refuse elements that do not fit, or are not those of the loop."""
        super().require_extra()
        if not all(a < b for a, b in self.elements.sectors):
            raise FormatError("sectors must be pairs [a, b] of a < b")
        if not self.level:
            raise FormatError("level must be positive")
        if self.held is not None:
            raise FormatError("held: elements are of a plant in continuous time, or of samples")

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:
        """Say that a signal has the name of another of the plant, or that the plant is sampled."""
        if any(isinstance(other, Samples) for other in claims):
            return "the plant is the samples of another: an element acts between them too"
        return misnamed(self.elements.signals, plant)

    def acting_words(self, plant: Plant) -> str:  # noqa: ARG002
        """Nothing: no disturbance of the plant acts."""
        return ""

    def named(self, plant: Plant) -> str:
        """Say which elements it is about."""
        return f"{self.kind} of {', '.join(self.elements_words(plant, self.elements.sectors))}"

    @property
    def names(self) -> tuple[str, ...]:
        """The signals' names."""
        return tuple(quoted(signal.name) for signal in self.elements.signals)

    @property
    def worst_text(self) -> str:
        """Say how many times as wide the sectors may be at least, rounded down."""
        return f"at least {digits_down(1 / self.level)} times as wide"

    def elements_words(self, plant: Plant, sectors: Sequence[Sector]) -> list[str]:
        """Return each element in words, its sector rounded inwards."""
        pairs = zip(element_words(self.elements, plant), map(inwards, sectors), strict=True)
        return [f"{w} = {self.phi} in [{low}, {high}], {y}" for (w, y), (low, high) in pairs]

    @property
    def phi(self) -> str:
        """An element in words."""
        return "phi(y)" if self.invariant else "phi(t, y)"

    def statement(self, plant: Plant) -> str:
        """Say for which elements what is proved."""
        said = "; ".join(self.elements_words(plant, self.elements.widened(self.level)))
        every = "every phi" if self.elements.count == 1 else "all phi"
        within = f"y {self.phi} between a y^2 and b y^2"
        if self.restricted:
            within = "phi(0) = 0 and (phi(y1) - phi(y2)) / (y1 - y2) from a to b"
        times = "that does not depend on time" if self.invariant else "constant or not in time"
        return (
            f"{self.kind}: x = 0 is globally exponentially stable{self.time_text} for {every} with "
            f"{within}, [a, b] its sector, {times}: "
            f"{said}, no other disturbance acting, on the {self.subject.on}"
        )


def read_numbers(table: Table) -> tuple[int, ...]:
    """Return the numbers of the disturbances that are those of elements, from 0."""
    return tuple(k - 1 for k in table.wholes("disturbances", MAX_WIDTH))


def element_words(elements: Elements, plant: Plant) -> list[tuple[str, str]]:
    """Return the disturbance and the signal of each element in words."""
    labels, said = plant.disturbances, list[tuple[str, str]]()
    for y, k in zip(elements.signals, elements.disturbances, strict=True):
        name = f"{quoted(split(labels[k])[0])} = " if k < len(labels) else ""
        said.append((f"{name}w{k + 1}", f"y = {outputs_text([y], plant)}"))
    return said


def inwards(sector: Sector) -> tuple[str, str]:
    """Return the ends of a sector, each as it is where that is short, else rounded inwards."""
    rounded: tuple[Callable[[Fraction], str], ...] = (digits_up, digits_down)
    texts = []
    for end, inward in zip(sector, rounded, strict=True):
        exact = number_text(end)
        texts.append(inward(end) if exact.startswith("~") else exact)
    return texts[0], texts[1]
