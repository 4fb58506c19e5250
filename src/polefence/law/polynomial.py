"""A gain of what is measured, polynomial in the parameters, and the words that it is shown by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, require_type
from polefence.base.explained import explained_fields
from polefence.law.law import Law, check_alpha, frozen, gain_rows, more_columns, rationals
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, padded
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import laws as proof
from polefence.proof.laws import Point
from polefence.proof.matrices import Rationals


@dataclass(frozen=True, eq=False, repr=False)
class PolynomialGain(Law):
    """u = K(p) y, y = C x + F w what is measured, K a polynomial: the sum of gains times c^e.

    c are the parameters' coordinates in [-1, 1], in which the plant is multi-affine: from the lower
    to the upper bound of p, or of 1/p where the plant is affine in that. Of a plant without
    parameters they are alpha, and all terms have one degree.

    Parameters
    ----------
    powers : sequence of sequence of int
        Exponents e of each term.
    gains : (terms, m, r) array
        [input unit / unit of the signal]
    measured : tuple of Output, optional
        The signals y; all states by default.
    parameters : tuple of Parameter
        The plant's.
    anti_windup : (n, m) array, optional
        Times sat(u) - u it is added to the rates of the law's own states, while inputs saturate.
        Zero in the rows of other states, and in the columns of the rates of its own.

    Raises
    ------
    InputError
        If the shapes do not fit together.
    """

    K = W = None
    powers: tuple[tuple[int, ...], ...]
    gains: Array
    measured: tuple[Output, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    anti_windup: Array | None = None

    @explained_fields
    def __post_init__(self) -> None:
        powers = tuple(tuple(int(power) for power in e) for e in self.powers)
        object.__setattr__(self, "powers", powers)
        object.__setattr__(self, "gains", frozen(self.gains, 3, "gains"))
        object.__setattr__(self, "measured", tuple(self.measured))
        widths = {len(e) for e in powers}
        if len(widths) != 1 or len(powers) != len(self.gains) or len(set(powers)) < len(powers):
            raise InputError("powers must be one per gain, of one length, without repeats")
        if self.parameters and widths != {len(self.parameters)}:
            raise InputError(
                f"powers must have {len(self.parameters)} exponents, one per parameter"
            )
        if not self.parameters and len({sum(e) for e in powers}) > 1:
            raise InputError("terms in alpha must be of one degree")
        for signal in self.measured:
            require_type(signal, Output, "each of measured", "plant.signal(name) returns one")
        if self.measured and len(self.measured) != self.gains.shape[2]:
            raise InputError(
                f"{len(self.measured)} signals are measured; the gains have {self.gains.shape[2]}"
            )
        if self.measured and not any(y.C for y in self.measured):
            raise InputError("measured: only disturbances; measure a signal of the states too")
        if self.anti_windup is not None:
            gain = frozen(self.anti_windup, 2, "anti_windup")
            object.__setattr__(self, "anti_windup", gain)
            if gain.shape != self.shape[::-1]:
                m, n = self.shape
                raise InputError(f"anti_windup must be {n} x {m}: states, and inputs")

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of inputs and states."""
        return self.gains.shape[1], self.C.shape[2]

    @property
    def domain(self) -> Domain:
        """The simplices in which alpha lives."""
        count = len(self.powers[0])
        return Domain((2,) * count if self.parameters else (count,))

    @property
    def degree(self) -> int:
        """Degree of K(p) C(p) in each parameter, or in alpha."""
        return self._own_degree + int(any(len(output.C) > 1 for output in self.measured))

    @property
    def _own_degree(self) -> int:
        """Degree of K(p) in each parameter, or in alpha."""
        return max(max(e, default=0) if self.parameters else sum(e) for e in self.powers)

    @property
    def fixed(self) -> bool:
        """Whether it is one gain of what is measured."""
        return len(self.powers) == 1 and (not any(self.powers[0]) or self.domain.corners == 1)

    @property
    def constant(self) -> bool:
        """Whether it is one gain of states."""
        return self.degree == 0

    @property
    def in_parts(self) -> bool:
        """Whether it is one in the parameters: on parts of their box it is too."""
        return bool(self.parameters)

    @property
    def names_signals(self) -> bool:
        """Always true: its document holds names of the plant's signals."""
        return True

    @cached_property
    def C(self) -> Array:
        """Rows of what is measured, (N, r, n), or (1, r, n) where they are the same everywhere."""
        if not self.measured:
            return np.eye(self.gains.shape[2])[None]
        C = np.array([[[float(x) for x in row] for row in M] for M in self._rows[0]])
        return C[:1] if all(len(output.C) < 2 for output in self.measured) else C

    @cached_property
    def F(self) -> Array | None:
        """Rows F of what is measured, as those of C; None where no disturbance passes."""
        if not self.passes:
            return None
        F = np.array([[[float(x) for x in row] for row in M] for M in self._rows[1]])
        return F[:1] if all(len(y.F) < 2 for y in self.measured) else F

    @property
    def passes(self) -> bool:
        """Whether a disturbance passes straight into a signal that it is given."""
        return any(y.F for y in self.measured)

    @property
    def passing_degree(self) -> int:
        """Degree of `passing` in each simplex."""
        if not self.passes:
            return 0
        return self._own_degree + int(any(len(y.F) > 1 for y in self.measured))

    def passing(self, alpha: Array) -> Array | None:
        """Return K F, what passes straight from disturbances to inputs; None: nothing."""
        if self.F is None:
            return None
        F = self.F[0] if len(self.F) == 1 else np.tensordot(alpha, self.F, 1)
        return np.asarray(self.own_gain(alpha) @ F)

    @property
    def _rows(self) -> tuple[tuple[Rationals, ...], tuple[Rationals, ...]]:
        """C and F of what is measured, at each vertex; nothing where no disturbance passes."""
        N, found = self.domain.corners, []
        for key in "CF":
            every = [getattr(y, key) for y in self.measured]
            width = max((len(row) for rows in every for row in rows), default=0)
            none = ((Fraction(0),) * width,)
            spread = [rows if len(rows) > 1 else (rows or none) * N for rows in every]
            count = N if width else 0
            found.append(tuple([list(rows[k]) for rows in spread] for k in range(count)))
        return found[0], found[1]

    @property
    def exact(self) -> proof.Law:
        """The law in rationals, with the rows that it measures at each vertex."""
        measured = self.measured
        C, F = self._rows
        names, degree = tuple(y.name for y in measured), proof.total_degree(self.powers)
        K = [rationals(gain) for gain in self.gains]
        more = None if self.anti_windup is None else rationals(self.anti_windup)
        return proof.Law(K, None, None, degree, self.powers, names, C, more, F)

    def document(self) -> dict[str, Any]:
        """Return it as plain data, as a proof file has it."""
        pairs = zip(self.powers, self.gains.tolist(), strict=True)
        terms = [{"powers": list(e), "K": K} for e, K in pairs]
        measured = {"measured": [signal.name for signal in self.measured]} if self.measured else {}
        more = {} if self.anti_windup is None else {"anti_windup": self.anti_windup.tolist()}
        return {"kind": "polynomial", "on": self.domain.on, "terms": terms} | measured | more

    @cached_property
    def form(self) -> Array:
        """Bernstein coefficients of [I; K C], (count, n + m, n), of the law's degree."""
        at = self.domain.nodes(self.degree)
        K = self.gain(at)
        one = np.broadcast_to(np.eye(K.shape[-1]), (len(K), K.shape[-1], K.shape[-1]))
        return self.domain.interpolated(np.concatenate([one, K], axis=1), self.degree)

    def __repr__(self) -> str:
        _, m, r = self.gains.shape
        return f"<PolynomialGain {m} x {r}, {len(self.powers)} terms, degree {self.degree}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        terms = [row for name, K in self.named_gains().items() for row in gain_rows(name, K)]
        return card(self.formula, [("with", "; ".join(self.definitions)), *terms])

    def terms(self, alpha: Any) -> Array:
        """Return c^e of each term at alpha (..., N), as (..., terms)."""
        a = np.asarray(alpha, dtype=float)
        c = self.domain.coordinates(a)
        c = c[..., 1::2] - c[..., ::2] if self.parameters else c
        return np.asarray(np.prod(c[..., None, :] ** np.array(self.powers), axis=-1))

    def gain(self, alpha: Any, clamp: bool = False) -> Array:
        """Return K(alpha) C(alpha), the gain of all states, (..., m, n) for alpha (..., N).

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex by more than rounding, unless ``clamp``.
        """
        a = check_alpha(alpha, self.domain.corners, clamp)
        return self.told(a, a)

    def own_gain(self, alpha: Any, clamp: bool = False) -> Array:
        """Return K(alpha), the gain of what is measured, (..., m, r) for alpha (..., N).

        One gain needs no alpha: it may be None.

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex by more than rounding, unless ``clamp``.
        """
        if alpha is None and self.fixed:
            return np.asarray(self.gains[0])
        a = check_alpha(alpha, self.domain.corners, clamp)
        return np.asarray(np.tensordot(self.terms(a), self.gains, 1))

    def told(self, alpha: Any, law: Any) -> Array:
        """Return the gain of all states of a plant at alpha where the law is told another one."""
        C = self.C[0] if len(self.C) == 1 else np.tensordot(alpha, self.C, 1)
        return np.asarray(np.tensordot(self.terms(law), self.gains, 1) @ C)

    def of(self, parameters: tuple[Parameter, ...]) -> PolynomialGain:
        """Return it with the parameters that alpha comes from."""
        return replace(self, parameters=parameters)

    def inside(self, plant: UncertainPlant, low: Point, high: Point) -> PolynomialGain:
        """Return the same law on a part of the box, to rounding."""
        part = self.exact.inside(low, high)
        measured = tuple(plant.signal(y.name) for y in self.measured)
        gains = np.array(part.K, dtype=float)
        powers, parameters = part.powers, plant.parameters
        return PolynomialGain(powers, gains, measured, parameters, self.anti_windup)

    def negated(self) -> PolynomialGain:
        """Return it with the other sign."""
        return replace(self, gains=-self.gains)

    def with_anti_windup(self, gain: Array | None) -> PolynomialGain:
        """Return it with another anti-windup gain, or with none."""
        return replace(self, anti_windup=gain)

    def with_states(self, more: int) -> PolynomialGain:
        """Return it for a plant with more states behind its n, which are not fed back."""
        gain = self._more_states(self.shape[1], more)
        if not self.measured:
            gains = more_columns(self.gains, more)
            return replace(self, gains=gains, anti_windup=gain)
        measured = tuple(padded(y, more) for y in self.measured)
        return replace(self, measured=measured, anti_windup=gain)

    def _more_states(self, n: int, more: int) -> Array | None:
        """Return the anti-windup gain with rows of zeros behind n states."""
        gain = self.anti_windup
        return None if gain is None else np.insert(gain, [n] * more, 0.0, axis=0)

    def late(self, n: int, more: int) -> PolynomialGain:
        """Return the law with zeros for delayed inputs, in the measured rows if there are any."""
        gain = self._more_states(n, more)
        if not self.measured:
            gains = np.insert(self.gains, [n] * more, 0.0, axis=2)
            return replace(self, gains=gains, anti_windup=gain)
        none = (0,) * more
        wider = (replace(y, C=[(*row[:n], *none, *row[n:]) for row in y.C]) for y in self.measured)
        return replace(self, measured=tuple(wider), anti_windup=gain)

    def with_filters(
        self,
        y: Sequence[Output],  # noqa: ARG002
        rates: Array,
        states: Sequence[Output],
        filters: Sequence[Output],
    ) -> PolynomialGain | None:
        """Return the law that also steps filters of its signals; None where no term is constant."""
        if not self.parameters and self.degree > 1:
            return None
        (terms, m, r), k = self.gains.shape, len(rates)
        gains = np.zeros((terms, m + k, r + k))
        gains[:, :m, :r] = self.gains
        whole = [e for e in self.powers if not any(e)] or self.powers  # alpha sums to one
        for j in (self.powers.index(e) for e in whole):
            gains[j, m + np.arange(k), np.arange(k) % r] = rates
            gains[j, m:, r:] = -np.diag(rates)
        measured = (*(padded(signal, k) for signal in self.measured or states), *filters)
        return PolynomialGain(self.powers, gains, measured, self.parameters)

    @property
    def title(self) -> str:
        """The kind of law in words, with its formula."""
        return f"{'one gain' if self.fixed else 'a polynomial'}, {self.formula}"

    @property
    def formula(self) -> str:
        """As u = (K0 + K1 c1 + K2 c1^2) y."""
        letter = "y" if self.measured else "x"
        if self.fixed:
            return f"u = K {letter}"
        c = "c" if self.parameters else "alpha"
        sums = [
            " ".join([f"K{k}", *(_power(f"{c}{j + 1}", p) for j, p in enumerate(e) if p)])
            for k, e in enumerate(self.powers)
        ]
        return f"u = ({' + '.join(sums)}) {letter}"

    @property
    def definitions(self) -> list[str]:
        """What y is, and how each coordinate of the law depends on its parameter."""
        lines = (
            [f"y = {', '.join(signal.label for signal in self.measured)}"] if self.measured else []
        )
        if self.anti_windup is not None:
            lines.append("while inputs saturate G (sat(u) - u) is added to the rates of its states")
        if self.fixed:
            return lines
        if not self.parameters:
            return [*lines, "alpha1 and so on: the weights of the vertices"]
        looked = [any(e[j] for e in self.powers) for j in range(len(self.parameters))]
        pairs = zip(self.parameters, looked, strict=True)
        return lines + [f"c{j + 1} = {_coordinate(p)}" for j, (p, used) in enumerate(pairs) if used]

    def named_gains(self) -> dict[str, Array]:
        """Return the gains of the terms: K alone, or K0, K1 and so on; G of the anti-windup."""
        names = ["K"] if self.fixed else [f"K{k}" for k in range(len(self.gains))]
        gains = dict(zip(names, self.gains, strict=True))
        if self.anti_windup is None:
            return gains
        G = self.anti_windup
        rows, columns = (np.flatnonzero(G.any(axis=axis)) for axis in (1, 0))
        return gains | {"G": G[rows.min(initial=len(G)) :, : columns.max(initial=0) + 1]}


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"


def _coordinate(p: Parameter) -> str:
    """Return the formula of a parameter's coordinate, from -1 to 1."""
    low, high = float(p.scheduling(p.low)), float(p.scheduling(p.high))
    middle, half = (low + high) / 2, (high - low) / 2
    variable = f"1/{p.name}" if p.inverted else p.name
    first, second = (variable, f"{middle:.6g}") if half > 0 else (f"{middle:.6g}", variable)
    unit = f" [{p.unit}]" if p.unit else ""
    text = f"({first} - {second})/{abs(half):.6g}" if middle else f"{variable}/{half:.6g}"
    text = text.replace("- -", "+ ")
    return f"{text}: -1 at {p.name} = {float(p.low):g}, 1 at {float(p.high):g}{unit}"
