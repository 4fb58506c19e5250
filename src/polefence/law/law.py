"""The interface of every kind of control law."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any, Self

import numpy as np

from polefence.base.errors import InputError, ParameterValueError, shown
from polefence.base.explained import explained
from polefence.law.coordinates import Coordinates
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter, simplex_weights
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array, floats
from polefence.proof import laws as proof
from polefence.proof.laws import Point
from polefence.proof.matrices import Rationals
from polefence.proof.short import Short

# A computed alpha is off the simplex by rounding; more is an error of the caller's.
ROUNDING = 1e-9


class Law(Short):
    """u = K(alpha) x, one class a kind: Z W^-1 of polynomials in alpha, or a polynomial, W = I.

    Attributes
    ----------
    K : (m, n) array, optional
        The gain of all states, of a kind that holds just this.
    powers : tuple of tuple of int
        Of a polynomial the exponents of each term; none of a quotient.
    gains : (terms, m, r) array, optional
        The terms' gains of what the law is given; None of a quotient.
    W : (count, n, n) array, optional
        Bernstein coefficients of the denominator; None where it is the identity.
    parameters : tuple of Parameter
        Those that alpha comes from, where the law knows them.
    measured : tuple of Output
        The signals that it is given; all states where there are none.
    anti_windup : (n, m) array, optional
        What sat(u) - u adds to the rates of its own states, of a kind that has some.
    """

    K: Array | None
    powers: tuple[tuple[int, ...], ...]
    gains: Array | None
    W: Array | None
    parameters: tuple[Parameter, ...] = ()
    measured: tuple[Output, ...] = ()
    anti_windup: Array | None = None

    # --- what it is ------------------------------------------------------------------------------

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of inputs and states."""
        raise NotImplementedError

    @property
    def domain(self) -> Domain:
        """The simplices in which alpha lives; one corner where the law never looks at it."""
        return Domain((1,))

    @property
    def degree(self) -> int:
        """Degree of `form` in each simplex."""
        return 0

    @property
    def denominator_degree(self) -> int:
        """Degree of W."""
        return 0 if self.W is None else self.degree

    @property
    def fixed(self) -> bool:
        """Whether it is one gain, independent of the parameters."""
        return False

    @property
    def in_parts(self) -> bool:
        """Whether its restriction to a part of a box is a law of the same kind."""
        return False

    @property
    def names_signals(self) -> bool:
        """Whether its `document` is read with the names of the plant's signals."""
        return False

    @property
    def form(self) -> Array:
        """Bernstein coefficients of [W; Z], or of [I; K], (count, n + m, n), of its degree."""
        raise NotImplementedError

    @property
    def one(self) -> dict[tuple[int, ...], float]:
        """The polynomial one in the law's coordinates: of alpha a power of its sum."""
        if self.parameters:
            return {(0,) * len(self.powers[0]): 1.0}
        degree = sum(self.powers[0])
        return {e: float(binomial(self.domain.sizes, e)) for e in self.domain.monomials(degree)}

    @property
    def C(self) -> Array:
        """Rows C of the measured y = C x, (N, r, n), or (1, r, n) if constant."""
        return np.eye(self.shape[1])[None]

    @property
    def exact(self) -> proof.Law:
        """The law in rationals."""
        raise NotImplementedError

    def document(self) -> dict[str, Any]:
        """Return it as plain data, as a proof file has it."""
        raise NotImplementedError

    # --- its gain --------------------------------------------------------------------------------

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

    def own_gain(self, alpha: Any, clamp: bool = False) -> Array:
        """Return the gain of y, (..., m, r) for alpha (..., N)."""
        return self.gain(alpha, clamp)

    def told(self, alpha: Any, law: Any) -> Array:  # noqa: ARG002
        """Return the gain of a plant's states at alpha when the law is given another alpha."""
        return self.gain(law)

    @property
    def passes(self) -> bool:
        """Whether a disturbance passes straight into a signal that it is given."""
        return False

    @property
    def passing_degree(self) -> int:
        """Degree of `passing` in each simplex."""
        return 0

    def passing(self, alpha: Array) -> Array | None:  # noqa: ARG002
        """Return what passes straight from disturbances to inputs, (..., m, q); None: nothing."""
        return None

    def parts(self, alpha: Array) -> tuple[Array, Array]:
        """Return W and Z, or I and K, at points alpha (count, N)."""
        K = np.asarray(self.gain(alpha))
        n = K.shape[-1]
        return np.broadcast_to(np.eye(n), (*K.shape[:-2], n, n)), K

    @cached_property
    def coordinates(self) -> Coordinates:
        """Those in which W is the identity in the middle of the family.

        Where W is not positive definite there, as in a law that was given, the units that even
        out its diagonal.
        """
        if self.W is None:
            return Coordinates(np.eye(self.shape[1]))
        centre = np.full(self.domain.corners, 1 / self.domain.corners)
        middle = np.tensordot(self.domain.basis(centre, self.degree), self.W, 1)
        whitened = Coordinates.whitening(middle)
        if whitened is None:
            size = np.sqrt(np.abs(np.diagonal(middle)))
            whitened = Coordinates(np.diag(1 / np.where(size > 0, size, 1.0)))
        return whitened

    @cached_property
    def even(self) -> tuple[Array, Array]:
        """W' = T W T' and Z' = Z T' of these coordinates, (count, n, n) and (count, m, n)."""
        T, n = self.coordinates, self.shape[1]
        return T.forms(self.form[:, :n]), T.gains(self.form[:, n:])

    def over(self, plant: UncertainPlant, alpha: Array) -> Array:  # noqa: ARG002
        """Return the gains of all states at points alpha (count, N) of a plant, (count, m, n)."""
        return np.asarray(self.gain(alpha))

    # --- the law beside a plant ------------------------------------------------------------------

    def fitted(self, plant: UncertainPlant) -> Law:
        """Return the law in the plant's parametrisation.

        Raises
        ------
        InputError
            If its vertices or parameters are others.
        """
        N = len(plant.vertices)
        if self.domain.corners != N:
            raise InputError(f"the law has {self.domain.corners} vertices; {plant.name} has {N}")
        theirs, ours = (_ranges(one.parameters) for one in (self, plant))
        if theirs and ours and theirs != ours:
            raise InputError(
                f"the law's parameters, or their ranges, are not those of {plant.name}"
            )
        return self

    def of(self, parameters: tuple[Parameter, ...]) -> Law:  # noqa: ARG002
        """Return it with the parameters that alpha comes from."""
        return self

    def domain_of(self, plant: UncertainPlant) -> Domain:  # noqa: ARG002
        """Return where claims about its loop are made."""
        return self.domain

    def divisible(self, plant: UncertainPlant) -> bool:
        """Whether claims about its loop may be proved in parts of a box, each with evidence."""
        if plant.moving and plant.dead_time is None:  # along motions X is one
            return False
        return self.in_parts and set(self.domain_of(plant).sizes) == {2}

    # --- other laws ------------------------------------------------------------------------------

    def inside(self, plant: UncertainPlant, low: Point, high: Point) -> Law:
        """Return the same law on a part of the box, to rounding.

        Parameters
        ----------
        plant : UncertainPlant
            The family on that part.
        low, high : tuple of Fraction
            Weights of each parameter's upper end.
        """
        raise NotImplementedError

    def negated(self) -> Self:
        """Return it with the other sign."""
        raise NotImplementedError

    def with_states(self, more: int) -> Self:
        """Return it for a plant with more states behind its n, which are not fed back."""
        raise NotImplementedError

    def late(self, n: int, more: int) -> Self:
        """Return the law with zero gain on delayed inputs, which follow its n states."""
        raise NotImplementedError

    def with_filters(
        self,
        y: Sequence[Output],  # noqa: ARG002
        rates: Array,  # noqa: ARG002
        states: Sequence[Output],  # noqa: ARG002
        filters: Sequence[Output],  # noqa: ARG002
    ) -> Law | None:
        """Return it beside filters of signals, which it steps and does not use.

        None of a kind that cannot be written so.

        Parameters
        ----------
        rates : (k,) array
            The filters' poles, their signs turned. The k-th is of the k-th signal, in turn.
        states, filters : sequence of Output
            The plant's, and the further ones of the larger plant.
        """
        return None

    # --- its words -------------------------------------------------------------------------------

    @property
    def title(self) -> str:
        """The kind of law in words, with its formula."""
        return "u = K(alpha) x"

    @property
    def formula(self) -> str:
        """The formula of u in terms of `named_gains`; "" where their names say it."""
        return ""

    @property
    def definitions(self) -> list[str]:
        """What the letters of the formula mean, a line each."""
        return []

    def named_gains(self) -> dict[str, Array]:
        """Return the gains shown to people, with their names."""
        raise NotImplementedError


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
            f"alpha must be {N} finite weights, one per vertex; got {shown(alpha)}"
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


def right_divide(Z: Array, W: Array) -> Array:
    """Return Z W^-1, batched, with W equilibrated first: its entries span many decades."""
    scale = np.sqrt(np.abs(np.diagonal(W, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0, scale, 1.0)
    even = W / (scale[..., :, None] * scale[..., None, :])
    right = np.swapaxes(Z / scale[..., None, :], -1, -2)
    solved = np.linalg.solve(np.swapaxes(even, -1, -2), right)
    return np.asarray(np.swapaxes(solved, -1, -2) / scale[..., None, :])


# --- for the kinds -------------------------------------------------------------------------------


def frozen(value: Any, dimensions: int, name: str) -> Array:
    """Return finite numbers as an array that cannot be written to.

    Raises
    ------
    InputError
        If they are none, or of other dimensions.
    """
    array = floats(value, name).copy()
    if array.ndim != dimensions or not np.all(np.isfinite(array)):
        raise InputError(f"{name} must be a finite array of {dimensions} dimensions")
    array.flags.writeable = False
    return array


def rationals(matrix: Array) -> Rationals:
    """Return the very values of doubles."""
    return [[Fraction(x) for x in row] for row in matrix.tolist()]


def gain_rows(name: str, K: Array) -> list[tuple[str, str]]:
    """Return a row for each input, of a table that shows a gain."""
    rows = [", ".join(f"{x:.6g}" for x in row) for row in K]
    return [(name if len(rows) == 1 else f"{name}, u{i + 1}", row) for i, row in enumerate(rows)]


def more_columns(matrices: Array, more: int) -> Array:
    """Return matrices with more columns of zeros."""
    return np.pad(matrices, [(0, 0)] * (np.ndim(matrices) - 1) + [(0, more)])


def _product(K: Array, x: Any) -> Array:
    state = floats(x, "x")
    n = K.shape[-1]
    # A column (n, 1) would broadcast into a wrong force without a word.
    if state.ndim == 0 or state.shape[-1] != n:
        raise InputError(f"x must end in {n} states; got shape {state.shape}, try x.ravel()")
    return np.asarray(np.einsum("...mn,...n->...m", K, state))


def _ranges(parameters: Sequence[Parameter]) -> list[tuple[str, Fraction, Fraction, str]]:
    return [(p.name, p.low, p.high, p.through) for p in parameters]
