"""Control laws in any form that users have: a gain, a scheduled or polynomial one, a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import prod
from typing import Any, TypeGuard

import numpy as np

from polefence.base.errors import InputError, ParameterValueError, require_type, shown, suggest
from polefence.base.explained import explained, explained_fields
from polefence.law.coordinates import Coordinates
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter, exact, simplex_weights
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array, floats
from polefence.proof import laws as proof
from polefence.proof.matrices import Rationals
from polefence.proof.short import Short

# A computed alpha is off the simplex by rounding; more is an error of the caller's.
ROUNDING = 1e-9

MAX_KNOTS, LARGEST = 200, 1e100


@explained
def check_alpha(alpha: Any, N: int, clamp: bool = False) -> Array:
    """Return alpha (..., N) as a point of the simplex.

    Raises
    ------
    ParameterValueError
        If alpha has another length, or lies off the simplex by more than rounding, unless
        ``clamp``: then negative entries are cut and the rest is scaled to sum to one.
    """
    a = floats(alpha, "alpha")
    if a.ndim == 0 or a.shape[-1] != N or not np.all(np.isfinite(a)):
        raise ParameterValueError(
            f"alpha must be {N} finite weights, one a vertex; got {shown(alpha)}"
        )
    off = max(float(-a.min()), float(np.abs(a.sum(axis=-1) - 1).max()))
    if off > ROUNDING and not clamp:
        raise ParameterValueError(
            f"alpha is off the simplex by {off:.3g} (weights >= 0, sum 1); the guarantee ends "
            "there (clamp=True takes a point of it)"
        )
    a = np.maximum(a, 0.0)
    total = a.sum(axis=-1, keepdims=True)
    if not np.all(total > 0):
        raise ParameterValueError("alpha has no positive weight")
    return np.asarray(a / total)


@dataclass(frozen=True, eq=False, repr=False)
class FixedGain(Short):
    """u = K x for every parameter value.

    Parameters
    ----------
    K : (m, n) array
        [input unit / state unit]
    """

    K: Array

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "K", _frozen(self.K, 2, "K"))

    @property
    def exact(self) -> proof.Law:
        """The law in rationals."""
        return proof.Law([_rationals(self.K)])

    def __repr__(self) -> str:
        return f"<FixedGain {self.K.shape[0]} x {self.K.shape[1]}: {self.K.tolist()}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        return card("u = K x", _gain_rows("K", self.K))

    @explained
    def gain(self, alpha: Any = None, clamp: bool = False) -> Array:  # noqa: ARG002
        """Return K; alpha is accepted, and not needed. Batched alpha gives batched gains."""
        lead = () if alpha is None else np.shape(alpha)[:-1]
        return np.broadcast_to(self.K, (*lead, *self.K.shape))

    def gain_at(self, clamp: bool = False, **values: Any) -> Array:  # noqa: ARG002
        """Return K, whatever the physical parameters."""
        return self.K

    @explained
    def control(self, alpha: Any, x: Any, clamp: bool = False) -> Array:
        """Return u = K x, (..., m) for x (..., n).

        Raises
        ------
        InputError
            If x does not end in n states.
        """
        return _product(self.gain(alpha, clamp), x)


class _Scheduled:
    """What laws that depend on alpha have in common."""

    parameters: tuple[Parameter, ...]

    def gain(self, alpha: Any, clamp: bool = False) -> Array:
        """Return the gain of all states, (..., m, n) for alpha (..., N)."""
        raise NotImplementedError

    @explained
    def gain_at(self, clamp: bool = False, **values: Any) -> Array:
        """Return it at physical parameter values, for example ``gain_at(m1=300, beta=0)``.

        Raises
        ------
        ParameterValueError
            If a value is missing, unknown, or outside its interval (unless ``clamp``).
        """
        weights = simplex_weights(self.parameters, values, clamp)
        return self.gain([float(w) for w in weights])

    @explained
    def control(self, alpha: Any, x: Any, clamp: bool = False) -> Array:
        """Return u, (..., m) for x (..., n).

        Raises
        ------
        InputError
            If x does not end in n states, or alpha lies off the simplex (unless ``clamp``).
        """
        return _product(self.gain(alpha, clamp), x)


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledGain(Short, _Scheduled):
    """u = K(alpha) x with K(alpha) = Z(alpha) W(alpha)^-1, Z and W polynomials in alpha.

    Leite & Peres (2005), equations (18), (19), of degree 1 on the simplex. It is evaluated as
    Z' W'^-1 T with W' = T W T' and Z' = Z T', near to the identity in the middle of the family:
    W itself spans more decades than doubles have digits.

    Parameters
    ----------
    W : (count, n, n) array
        Bernstein coefficients, in the order of `Domain.monomials`; of degree 1 the positive
        definite vertex matrices.
    Z : (count, m, n) array
    parameters : tuple of Parameter
        Lets `gain_at` find alpha from physical values.
    degree : int
    sizes : tuple of int, optional
        Corners of each simplex; by default one simplex, of as many corners as the degree says.

    Raises
    ------
    InputError
        If the shapes do not fit together.
    """

    W: Array
    Z: Array
    parameters: tuple[Parameter, ...] = ()
    degree: int = 1
    sizes: tuple[int, ...] = ()

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "W", _frozen(self.W, 3, "W"))
        object.__setattr__(self, "Z", _frozen(self.Z, 3, "Z"))
        count, n, _ = self.W.shape
        if self.W.shape[2] != n or self.Z.shape[0] != count or self.Z.shape[2] != n:
            raise InputError(f"W {self.W.shape} and Z {self.Z.shape} do not fit together")
        object.__setattr__(self, "sizes", tuple(self.sizes) or (count,))
        if self.domain.count(self.degree) != count:
            raise InputError(
                f"{count} matrices W; degree {self.degree} needs {self.domain.count(self.degree)}"
            )

    @property
    def domain(self) -> Domain:
        """The simplices in which alpha lives."""
        return Domain(self.sizes)

    @property
    def exact(self) -> proof.Law:
        """The law in rationals."""
        W, Z = ([_rationals(M) for M in each] for each in (self.W, self.Z))
        return proof.Law(None, W, Z, self.degree)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Those in which W is the identity in the middle of the family.

        Where W is not positive definite there, as in a law that was given, the units that even
        out its diagonal.
        """
        centre = np.full(self.domain.corners, 1 / self.domain.corners)
        middle = np.tensordot(self.domain.basis(centre, self.degree), self.W, 1)
        found = Coordinates.whitening(middle)
        if found is None:
            size = np.sqrt(np.abs(np.diagonal(middle)))
            found = Coordinates(np.diag(1 / np.where(size > 0, size, 1.0)))
        return found

    @cached_property
    def even(self) -> tuple[Array, Array]:
        """W' = T W T' and Z' = Z T' of these coordinates, (count, n, n) and (count, m, n)."""
        T = self.coordinates
        return T.forms(self.W), T.gains(self.Z)

    def __repr__(self) -> str:
        _, m, n = self.Z.shape
        kind = f", degree {self.degree}" if self.degree != 1 else ""
        return f"<ScheduledGain {m} x {n}, {self.domain.corners} vertices{kind}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        known = [("degree", str(self.degree)), *map(_range_row, self.parameters)]
        corners = self.domain.corners
        middle = self.gain(np.full(corners, 1 / corners))
        return card("u = Z W^-1 x", [*known, *_gain_rows("K in the middle", middle)])

    def gain(self, alpha: Any, clamp: bool = False) -> Array:
        """Return K(alpha), (..., m, n) for alpha (..., N); on a box, at alpha's marginals.

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex by more than rounding, unless ``clamp``.
        """
        a = check_alpha(alpha, self.domain.corners, clamp)
        weights = self.domain.basis(a, self.degree)
        W, Z = self.even
        even = right_divide(np.tensordot(weights, Z, 1), np.tensordot(weights, W, 1))
        return even @ self.coordinates.T


@dataclass(frozen=True, eq=False, repr=False)
class PolynomialGain(Short, _Scheduled):
    """u = K(p) y, y = C x what is measured, K a polynomial: the sum of its terms' gains times c^e.

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

    Raises
    ------
    InputError
        If the shapes do not fit together.
    """

    powers: tuple[tuple[int, ...], ...]
    gains: Array
    measured: tuple[Output, ...] = ()
    parameters: tuple[Parameter, ...] = ()

    @explained_fields
    def __post_init__(self) -> None:
        powers = tuple(tuple(int(power) for power in e) for e in self.powers)
        object.__setattr__(self, "powers", powers)
        object.__setattr__(self, "gains", _frozen(self.gains, 3, "gains"))
        object.__setattr__(self, "measured", tuple(self.measured))
        widths = {len(e) for e in powers}
        if len(widths) != 1 or len(powers) != len(self.gains) or len(set(powers)) < len(powers):
            raise InputError("powers must be one a gain, of one length, each once")
        if self.parameters and widths != {len(self.parameters)}:
            raise InputError(f"powers must have {len(self.parameters)} exponents, one a parameter")
        if not self.parameters and len({sum(e) for e in powers}) > 1:
            raise InputError("terms in alpha must be of one degree")
        for own in self.measured:
            require_type(own, Output, "each of measured", "plant.signal(name) returns one")
        if self.measured and len(self.measured) != self.gains.shape[2]:
            raise InputError(
                f"{len(self.measured)} signals are measured; the gains have {self.gains.shape[2]}"
            )

    @property
    def domain(self) -> Domain:
        """The simplices in which alpha lives."""
        count = len(self.powers[0])
        return Domain((2,) * count if self.parameters else (count,))

    @property
    def degree(self) -> int:
        """Degree of K(p) C(p) in each parameter, or in alpha."""
        own = max(max(e, default=0) if self.parameters else sum(e) for e in self.powers)
        return own + int(any(len(output.C) > 1 for output in self.measured))

    @property
    def fixed(self) -> bool:
        """Whether it is one gain of what is measured."""
        return len(self.powers) == 1 and (not any(self.powers[0]) or self.domain.corners == 1)

    @property
    def constant(self) -> bool:
        """Whether it is one gain of states."""
        return self.degree == 0

    @cached_property
    def C(self) -> Array:
        """Rows of what is measured, (N, r, n), or (1, r, n) where they are the same everywhere."""
        if not self.measured:
            return np.eye(self.gains.shape[2])[None]
        count = max(len(output.C) for output in self.measured)
        rows = [np.array([[float(x) for x in row] for row in y.C]) for y in self.measured]
        return np.stack([np.broadcast_to(C, (count, C.shape[1])) for C in rows], axis=1)

    @property
    def exact(self) -> proof.Law:
        """The law in rationals, with the rows that it measures at each vertex."""
        N, measured = self.domain.corners, self.measured
        rows = [y.C if len(y.C) > 1 else y.C * N for y in measured]
        C = tuple([list(row[k]) for row in rows] for k in range(N)) if rows else ()
        names, degree = tuple(y.name for y in measured), proof.total_degree(self.powers)
        K = [_rationals(own) for own in self.gains]
        return proof.Law(K, degree=degree, powers=self.powers, measured=names, C=C)

    @property
    def one(self) -> dict[tuple[int, ...], float]:
        """One as a polynomial in which the law's terms are: of alpha a power of its sum."""
        if self.parameters:
            return {(0,) * len(self.powers[0]): 1.0}
        degree = sum(self.powers[0])
        return {e: float(binomial(self.domain.sizes, e)) for e in self.domain.monomials(degree)}

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
        from polefence.law.words import definitions, formula, terms_of  # deferred: needs this one

        terms = [row for name, K in terms_of(self).items() for row in _gain_rows(name, K)]
        return card(formula(self), [("with", "; ".join(definitions(self))), *terms])

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

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex by more than rounding, unless ``clamp``.
        """
        a = check_alpha(alpha, self.domain.corners, clamp)
        return np.asarray(np.tensordot(self.terms(a), self.gains, 1))

    def told(self, alpha: Any, law: Any) -> Array:
        """Return the gain of all states of a plant at alpha where the law is told another one."""
        C = self.C[0] if len(self.C) == 1 else np.tensordot(alpha, self.C, 1)
        return np.asarray(np.tensordot(self.terms(law), self.gains, 1) @ C)


Law = FixedGain | ScheduledGain | PolynomialGain


def _range_row(p: Parameter) -> tuple[str, str]:
    return p.name, f"{float(p.low):g} to {float(p.high):g} {p.unit}"


def _gain_rows(name: str, K: Array) -> list[tuple[str, str]]:
    """Return a row for each input, of a table that shows a gain."""
    rows = [", ".join(f"{x:.6g}" for x in row) for row in K]
    return [(name if len(rows) == 1 else f"{name}, u{i + 1}", row) for i, row in enumerate(rows)]


def _product(K: Array, x: Any) -> Array:
    state = floats(x, "x")
    n = K.shape[-1]
    # A column (n, 1) would broadcast into a wrong force without a word.
    if state.ndim == 0 or state.shape[-1] != n:
        raise InputError(f"x must end in {n} states; got shape {state.shape}, try x.ravel()")
    return np.asarray(np.einsum("...mn,...n->...m", K, state))


def right_divide(Z: Array, W: Array) -> Array:
    """Return Z W^-1, batched, with W equilibrated first: its entries span many decades."""
    scale = np.sqrt(np.abs(np.diagonal(W, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0, scale, 1.0)
    even = W / (scale[..., :, None] * scale[..., None, :])
    right = np.swapaxes(Z / scale[..., None, :], -1, -2)
    solved = np.linalg.solve(np.swapaxes(even, -1, -2), right)
    return np.asarray(np.swapaxes(solved, -1, -2) / scale[..., None, :])


def _rationals(matrix: Array) -> Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]


def _frozen(value: Any, dimensions: int, name: str) -> Array:
    array = floats(value, name).copy()
    if array.ndim != dimensions or not np.all(np.isfinite(array)):
        raise InputError(f"{name} must be a finite array of {dimensions} dimensions")
    array.flags.writeable = False
    return array


@explained
def given_law(plant: UncertainPlant, law: Any) -> Law:
    """Return a law in any of the forms that users have it in, checked against the plant.

    Where alpha comes from parameters, a scheduled law of degree 1 on the simplex is returned as
    one on their box: there it is the same law, and the box is what matters.

    Raises
    ------
    InputError
        If it is none, or does not fit.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    law = law.as_law() if hasattr(law, "as_law") else law
    if not isinstance(law, FixedGain | ScheduledGain | PolynomialGain):
        law = FixedGain(_matrix(plant, law))
    n, m = plant.shape
    shape = shape_of(law)
    if shape != (m, n):
        raise InputError(f"the gain is {shape[0]} x {shape[1]}; {plant.name} needs {m} x {n}")
    if isinstance(law, ScheduledGain):
        return _scheduled(plant, law)
    if isinstance(law, PolynomialGain):
        _require_vertices(plant, law)
    found: Law = law
    return found


def is_one(law: Law) -> TypeGuard[FixedGain | PolynomialGain]:
    """Whether a law is one gain of what it is given, and so never looks at the parameters."""
    return isinstance(law, FixedGain) or (isinstance(law, PolynomialGain) and law.fixed)


def shape_of(law: Law) -> tuple[int, int]:
    """Return the numbers of inputs and states of a law."""
    if isinstance(law, PolynomialGain):
        return law.gains.shape[1], law.C.shape[2]
    m, n = law.K.shape if isinstance(law, FixedGain) else law.Z.shape[1:]
    return m, n


def _matrix(plant: UncertainPlant, law: Any) -> Any:
    if hasattr(law, "nstates"):  # of python-control
        if law.nstates or not hasattr(law, "D"):
            raise InputError(
                "the controller is a dynamic system; give a static gain, u = K x, and put states "
                "of the controller, such as integrals, into the plant"
            )
        law = law.D
    try:
        K = np.asarray(law, dtype=float)
    except (TypeError, ValueError, OverflowError):
        K = np.zeros(0)
    if K.ndim != 2 or not np.all(np.isfinite(K)):
        n, m = plant.shape
        raise InputError(f"the gain must be {m} x {n} finite numbers, a list of rows: [[...]]")
    return K


def _require_vertices(plant: UncertainPlant, law: ScheduledGain | PolynomialGain) -> None:
    N = len(plant.vertices)
    if law.domain.corners != N:
        raise InputError(f"the law has {law.domain.corners} vertices; {plant.name} has {N}")
    theirs, ours = (_ranges(each.parameters) for each in (law, plant))
    if theirs and ours and theirs != ours:
        raise InputError(f"the law's parameters, or their ranges, are not those of {plant.name}")


def _scheduled(plant: UncertainPlant, law: ScheduledGain) -> ScheduledGain:
    _require_vertices(plant, law)
    if plant.parameters and law.degree == 1:
        return replace(law, sizes=Domain.of("box", len(plant.vertices)).sizes)
    return law


def _ranges(parameters: Sequence[Parameter]) -> list[tuple[str, Fraction, Fraction, str]]:
    return [(p.name, p.low, p.high, p.through) for p in parameters]


def domain_of(plant: UncertainPlant, law: Law) -> Domain:
    """Return where a claim is made: the law's own domain; the box where there are parameters."""
    if not isinstance(law, FixedGain):
        return law.domain
    return Domain.of("box" if plant.parameters else "simplex", len(plant.vertices))


def divisible(plant: UncertainPlant, law: Law) -> bool:
    """Whether claims about its loop may be proved in parts of a box, each with its own evidence."""
    if plant.moving:  # along motions X is one
        return False
    own = isinstance(law, FixedGain) or (isinstance(law, PolynomialGain) and law.parameters)
    return bool(own) and set(domain_of(plant, law).sizes) == {2}


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Short):
    """u = K(p) x, K multi-linear in the physical parameters between the knots of a grid.

    Parameters
    ----------
    parameters : tuple of Parameter
        The plant's, in its order.
    grid : mapping
        Name of each parameter to its knots, rising, from its lower to its upper bound or beyond.
    gains : (k1, k2, ..., m, n) array
        The gain at every knot, axes in the order of ``parameters``.

    Raises
    ------
    InputError
        If a parameter or knot is missing, knots do not rise or do not cover the interval, or the
        shapes do not fit.
    """

    parameters: tuple[Parameter, ...]
    grid: Mapping[str, Sequence[Any]]
    gains: Array

    @explained_fields
    def __post_init__(self) -> None:
        names = [p.name for p in self.parameters]
        if not names:
            raise InputError("a table of gains needs a plant with parameters")
        for name in self.grid:
            if name not in names:
                raise InputError(f"grid: unknown parameter {name!r}; {suggest(str(name), names)}")
        for name in names:
            if name not in self.grid:
                raise InputError(f"grid: the knots of {name} are missing")
        knots = {p.name: _knots(p, self.grid[p.name]) for p in self.parameters}
        object.__setattr__(self, "grid", knots)
        try:
            gains: Array = np.array(self.gains, dtype=float)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError("gains must be nested lists of numbers, all of one shape") from error
        shape = tuple(len(knots[name]) for name in names)
        if gains.ndim != len(names) + 2 or gains.shape[: len(names)] != shape:
            raise InputError(f"gains has shape {gains.shape}; the grid needs {shape} + (m, n)")
        if not np.all(np.abs(gains) <= LARGEST):
            raise InputError(f"gains must be finite numbers, of magnitudes up to {LARGEST:g}")
        gains.flags.writeable = False
        object.__setattr__(self, "gains", gains)

    def __repr__(self) -> str:
        sizes = " x ".join(str(len(k)) for k in self.grid.values())
        m, n = self.gains.shape[-2:]
        return f"<GainTable {m} x {n}, {sizes} knots>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        known = (
            (name, f"{len(knots)} knots from {float(knots[0]):g} to {float(knots[-1]):g}")
            for name, knots in self.grid.items()
        )
        m, n = self.gains.shape[-2:]
        return card("u = K(p) x, from a table", [("gains", f"{m} x {n}"), *known])

    @cached_property
    def axes(self) -> list[Array]:
        """Knots of each parameter, in floats."""
        return [np.array([float(v) for v in self.grid[p.name]]) for p in self.parameters]

    @property
    def flat(self) -> Array:
        """All gains in one row, the first parameter varying slowest."""
        return self.gains.reshape(-1, *self.gains.shape[-2:])

    @explained
    def gain_at(self, clamp: bool = False, **values: Any) -> Array:
        """Return K at physical parameter values.

        Raises
        ------
        ParameterValueError
            If a value is missing, unknown, or outside its interval (unless ``clamp``).
        """
        names = [p.name for p in self.parameters]
        if set(values) != set(names):
            raise ParameterValueError(f"give a value of every parameter: {', '.join(names)}")
        point = []
        for p in self.parameters:
            p.weights(values[p.name], clamp)  # refuses what lies outside
            point.append(min(max(float(values[p.name]), float(p.low)), float(p.high)))
        return np.asarray(self.at(np.array([point]))[0])

    @explained
    def at(self, points: Array) -> Array:
        """Return K at points (count, parameters), as (count, m, n)."""
        K = np.zeros((len(points), *self.gains.shape[-2:]))
        places = []
        for axis, column in zip(self.axes, points.T, strict=True):
            i = np.clip(np.searchsorted(axis, column, side="right") - 1, 0, len(axis) - 2)
            places.append((i, (column - axis[i]) / (axis[i + 1] - axis[i])))
        for corner in np.ndindex(*(2,) * len(places)):
            weight = prod(t if bit else 1 - t for (_, t), bit in zip(places, corner, strict=True))
            index = tuple(i + bit for (i, _), bit in zip(places, corner, strict=True))
            K += np.asarray(weight)[:, None, None] * self.gains[index]
        return K


def _knots(parameter: Parameter, given: Sequence[Any]) -> tuple[Fraction, ...]:
    where = f"grid: knots of {parameter.name}"
    if isinstance(given, str | Mapping) or not isinstance(given, Iterable):
        raise InputError(f"{where} must be a list of numbers")
    knots = [exact(v, where) for v in given]
    if not 2 <= len(knots) <= MAX_KNOTS:
        raise InputError(f"{where}: {len(knots)} given; use 2 to {MAX_KNOTS}")
    # a float bound is not the decimal one
    rounding = (parameter.high - parameter.low) / 10**12
    for i, bound in ((0, parameter.low), (-1, parameter.high)):
        if abs(knots[i] - bound) <= rounding:
            knots[i] = bound
    if not all(a < b for a, b in pairwise(knots)):
        raise InputError(f"{where} must rise")
    if knots[0] > parameter.low or knots[-1] < parameter.high:
        raise InputError(
            f"{where} must cover [{float(parameter.low):g}, {float(parameter.high):g}]"
        )
    return tuple(knots)


def table_from(parameters: tuple[Parameter, ...], data: Any) -> GainTable:
    """Return a table from plain data, {"grid": {name: knots}, "gains": nested lists}.

    The gains may be called K.

    Raises
    ------
    InputError
        If it is malformed or does not fit the parameters.
    """
    if isinstance(data, dict) and set(data) == {"grid", "K"}:
        data = {"grid": data["grid"], "gains": data["K"]}
    if not isinstance(data, dict) or set(data) != {"grid", "gains"}:
        raise InputError('a table of gains is {"grid": {name: knots}, "gains": nested lists}')
    if not isinstance(data["grid"], dict):
        raise InputError('grid must name the knots of each parameter: {"m1": [...], ...}')
    return GainTable(parameters, data["grid"], data["gains"])
