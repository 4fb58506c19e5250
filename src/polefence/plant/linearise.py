"""A nonlinear plant linearised into a polytope, and how far the polytope misses it between corners.

Jacobians come from complex steps: f is evaluated at x + i h e_j with h so small that nothing is
lost by subtraction (Squire & Trapp, SIAM Review 40(1), 110-112, 1998). The vertices are the
Jacobians at the corners of the parameters' box; between them the family is multi-affine in the
scheduling variables, and f need not be.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import MultiAffinityError, PlantError
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, split
from polefence.plant.parameters import Parameter
from polefence.plant.points import values_text
from polefence.plant.system import Array
from polefence.proof.short import Short

STEP = 1e-30  # of the complex step

Point = Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Linearised(Short):
    """A family of Jacobians, and what is known of its distance from the plant.

    Attributes
    ----------
    plant : UncertainPlant
        The Jacobians at the corners of the box.
    declared : bool
        Whether the Jacobians were declared multi-affine, so that proofs hold for them.
    error : float
        The largest difference between Jacobian and family that was found, as a share of the
        largest value of that entry.
    place : str
        That entry, "A[2][1]".
    values : dict
        The parameters there.
    count : int
        How many points were looked at.
    """

    plant: UncertainPlant
    declared: bool
    error: float
    place: str
    values: dict[str, float]
    count: int

    def __str__(self) -> str:
        if self.declared:
            return f"declared multi-affine; {self.count} points agree to {self.error:.1g}"
        where = f"{self.place} at {values_text(self.plant, self.values)}"
        return (
            f"unproved: what is proved of {self.plant.name!r} holds for the polytope; the Jacobian "
            f"differs from it by up to {100 * self.error:.2g} % of an entry ({where}) in "
            f"{self.count} points"
        )

    def __repr__(self) -> str:
        return f"<Linearised {self.plant!r}, {self}>"


@explained
def linearise(
    f: Callable[..., Any],
    x0: Any,
    u0: Any,
    parameters: Sequence[Parameter],
    w0: Any = None,
    outputs: Mapping[str, Callable[..., Any]] | None = None,
    declared: bool = False,
    **names: Any,
) -> Linearised:
    """Linearise x' = f(x, u, p) about an equilibrium, over a box of parameters p.

    Parameters
    ----------
    f : callable
        Takes arrays x (n,), u (m,), with ``w0`` also w (q,), and the parameters by name; returns n
        rates, in discrete time the next state. It is called with complex numbers: use ``np.sin``
        rather than ``math.sin``, and neither ``abs`` nor comparisons of what depends on x or u.
    x0, u0, w0 : array, or callable of the parameters by name
        The equilibrium [SI units]; w0 where disturbances act.
    parameters : sequence of Parameter
        ``through="1/m"`` says that a parameter acts by its inverse.
    outputs : mapping of "name [unit]" to callable, optional
        Each takes what f takes and returns one number.
    declared : bool
        Declare that all Jacobians are multi-affine in the scheduling variables. It is then an error
        if a point says otherwise.
    **names
        Of `UncertainPlant`: ``name``, ``states``, ``inputs``, ``disturbances``, ``sample_time``.

    Returns
    -------
    Linearised
        ``str()`` of it says what a proof about its plant covers. Unless it is declared, the plant's
        name says "linearised", and so does what is printed of its proofs.

    Raises
    ------
    PlantError
        If f cannot be differentiated, or does not rest at x0, u0.
    MultiAffinityError
        If the Jacobians are declared multi-affine and are not; the entry is named.
    """
    box = (parameters,) if isinstance(parameters, Parameter) else tuple(parameters)
    if not box:
        raise PlantError(
            "linearise needs a parameter; UncertainPlant.from_vertices takes one plant"
        )
    system = _Function(f, x0, u0, w0, dict(outputs or {}), names.get("sample_time") is not None)
    corners = [system.jacobians(point) for point in _corners(box)]
    named = dict(names)
    label = str(named.pop("name", "") or getattr(f, "__name__", "plant").strip("<>"))
    plant = UncertainPlant.from_vertices(
        [jacobian["A"] for jacobian in corners],
        [jacobian["B"] for jacobian in corners],
        None if w0 is None else [jacobian["E"] for jacobian in corners],
        parameters=box,
        name=label if declared else f"{label}, linearised",
        outputs=tuple(_outputs(system, corners)),
        **named,
    )
    points = list(_points(box))
    error, place, values = _worst(plant, system, corners, points)
    if declared and error > 1e-9:  # more than rounding
        variables = ", ".join(p.through for p in box)
        raise MultiAffinityError(
            f"{place} is not multi-affine in {variables}: at {values_text(plant, values)} it "
            f"differs from the corners' by {100 * error:.2g} %; change a parameter's through (p or "
            "1/p), or do not declare it"
        )
    return Linearised(plant, declared, error, place, values, len(points))


@dataclass(frozen=True, eq=False)
class _Function:
    """What is differentiated, with its equilibrium."""

    f: Callable[..., Any]
    x0: Any
    u0: Any
    w0: Any
    outputs: Mapping[str, Callable[..., Any]]
    discrete: bool

    def at_rest(self, point: Point) -> list[Array]:
        """Return x0, u0 and w0 at a point."""
        given = [("x0", self.x0), ("u0", self.u0)]
        given += [] if self.w0 is None else [("w0", self.w0)]
        return [_vector(name, _called(name, function, point)) for name, function in given]

    def jacobians(self, point: Point) -> dict[str, Array]:
        """Return A, B, E and the rows of outputs at a point."""
        rest = self.at_rest(point)
        matrices = dict(zip("ABE", self._of("f", self.f, rest, point, len(rest[0])), strict=False))
        value = _value("f", self.f, rest, point, len(rest[0])).real
        value = value - rest[0] if self.discrete else value
        pairs = zip(matrices.values(), rest, strict=True)
        terms = np.sum([np.abs(M) @ np.abs(v) for M, v in pairs], axis=0) + 1
        worst = int(np.argmax(np.abs(value) / terms))
        if not abs(value[worst]) <= 1e-6 * terms[worst]:  # it is to be at rest
            raise PlantError(
                f"x0, u0 are not an equilibrium {_at(point)}: component {worst + 1} of f "
                f"{'- x0 ' if self.discrete else ''}is {value[worst]:.3g}, not 0; give them as "
                "functions of the parameters"
            )
        for name, output in self.outputs.items():
            rows = zip("CDF", self._of(name, output, rest, point, 1), strict=False)
            matrices |= {f"{name}.{key}": M for key, M in rows}
        return matrices

    def _of(
        self, name: str, f: Callable[..., Any], rest: list[Array], point: Point, rows: int
    ) -> Iterator[Array]:
        """Yield the Jacobians of one function in x, u and w."""
        for k, values in enumerate(rest):
            columns = []
            for j in range(len(values)):
                moved = [v.astype(complex) for v in rest]
                moved[k][j] += 1j * STEP
                columns.append(_value(name, f, moved, point, rows).imag / STEP)
            M = np.array(columns).T.reshape(rows, len(values))
            self._require_differences(name, f, rest, point, k, M)
            yield M

    @staticmethod
    def _require_differences(
        name: str, f: Callable[..., Any], rest: list[Array], point: Point, k: int, M: Array
    ) -> None:
        """Refuse a function that loses imaginary parts: differences then say something else."""
        for j in range(len(rest[k])):
            h = np.cbrt(np.finfo(float).eps) * max(1.0, abs(rest[k][j]))
            sides = []
            for sign in (1, -1):
                moved = [v.copy() for v in rest]
                moved[k][j] += sign * h
                sides.append(_value(name, f, moved, point, len(M)).real)
            size = max(np.abs(M).max(), np.abs(sides).max() * np.sqrt(np.finfo(float).eps))
            apart = np.abs((sides[0] - sides[1]) / (2 * h) - M[:, j])
            if not apart.max() <= 1e-4 * size:
                raise PlantError(
                    f"{name} cannot be differentiated {_at(point)}: the complex step and "
                    f"differences disagree in component {int(np.argmax(apart)) + 1} by "
                    f"{apart.max():.2g}; it must be smooth there, and keep complex numbers "
                    "(no abs, real, float, comparisons)"
                )


def _value(name: str, f: Callable[..., Any], at: list[Array], point: Point, rows: int) -> Any:
    try:
        with warnings.catch_warnings():  # what loses imaginary parts is found by differences
            warnings.simplefilter("ignore", np.exceptions.ComplexWarning)
            given = f(*(v.copy() for v in at), **point)
        values = np.atleast_1d(np.asarray(given, dtype=complex))
    except (TypeError, ValueError, ArithmeticError, LookupError, AttributeError) as problem:
        raise PlantError(
            f"{name} fails {_at(point)}: {problem}; it is called with complex arrays and the "
            "parameters by name: use np.sin rather than math.sin"
        ) from problem
    if values.shape != (rows,) or not np.all(np.isfinite(values)):
        raise PlantError(f"{name} must return {rows} finite numbers {_at(point)}")
    return values


def _called(name: str, function: Any, point: Point) -> Any:
    """Return a value, or what a function of the parameters returns."""
    try:
        return function(**point) if callable(function) else function
    except (TypeError, ValueError, ArithmeticError, LookupError) as problem:
        raise PlantError(
            f"{name} fails {_at(point)}: {problem}; a function of it is called with the "
            "parameters by name"
        ) from problem


def _vector(name: str, value: Any) -> Array:
    try:
        vector = np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError, OverflowError) as problem:
        raise PlantError(f"{name} must be a list of numbers: {problem}") from problem
    if vector.ndim != 1 or not len(vector) or not np.all(np.isfinite(vector)):
        raise PlantError(f"{name} must be a list of finite numbers")
    return vector


def _at(point: Point) -> str:
    return "at " + ", ".join(f"{name} = {value:g}" for name, value in point.items())


def _corners(box: Sequence[Parameter]) -> Iterator[dict[str, float]]:
    """Yield the corners in the order of vertices."""
    for ends in itertools.product(*((p.low, p.high) for p in box)):
        yield {p.name: float(end) for p, end in zip(box, ends, strict=True)}


def _points(box: Sequence[Parameter]) -> Iterator[dict[str, float]]:
    """Yield points of the box: a grid of three, as far as it is small, and random ones."""
    grid = itertools.product((0.0, 0.5, 1.0), repeat=len(box))
    random = np.random.default_rng(0).random((200, len(box)))
    for shares in itertools.chain(itertools.islice(grid, 729), random):
        yield {
            p.name: float(p.low) + float(share) * float(p.high - p.low)
            for p, share in zip(box, shares, strict=True)
        }


def _outputs(system: _Function, corners: Sequence[Mapping[str, Array]]) -> Iterator[Output]:
    for label in system.outputs:
        keys = [key for key in "CDF" if f"{label}.{key}" in corners[0]]
        rows: dict[str, Any]
        rows = {
            key: [jacobian[f"{label}.{key}"][0].tolist() for jacobian in corners] for key in keys
        }
        yield Output(*split(label), **rows)


def _worst(
    plant: UncertainPlant,
    system: _Function,
    corners: Sequence[Mapping[str, Array]],
    points: Sequence[dict[str, float]],
) -> tuple[float, str, dict[str, float]]:
    """Return the largest difference from the family, its entry, and the point."""
    alpha = np.array([plant.alpha(clamp=True, **point) for point in points])
    jacobians = [system.jacobians(point) for point in points]
    worst = (0.0, "A[1][1]", points[0])
    for key in corners[0]:
        there = np.array([jacobian[key] for jacobian in jacobians])
        family = np.tensordot(alpha, np.array([jacobian[key] for jacobian in corners]), 1)
        size = np.maximum(np.abs(there), np.abs(family)).max(axis=0)
        apart = np.abs(there - family) / np.where(size > 0, size, 1.0)
        k, i, j = map(int, np.unravel_index(int(np.argmax(apart)), apart.shape))
        if apart[k, i, j] > worst[0]:
            worst = float(apart[k, i, j]), f"{key}[{i + 1}][{j + 1}]", points[k]
    return worst
