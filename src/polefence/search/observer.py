"""Observers by duality: the theorems on (A', C') give L, and its poles are proved to stay inside.

x^' = A x^ + B u + L (y - C x^),    error e = x - x^:  e' = (A - L C) e
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError
from polefence.base.explained import explained, explained_fields
from polefence.certify.checks import in_time_of
from polefence.certify.design import Design, require_kind
from polefence.certify.measured import dual_plant, read_measured, require_observable, transposed
from polefence.law.laws import check_alpha
from polefence.lmi.conditions.methods import Method
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array, Exact
from polefence.proof.short import Short
from polefence.region.regions import Region
from polefence.search.place import place, tightest


@explained
def observe(
    plant: UncertainPlant,
    measured: Any,
    region: Region | None = None,
    method: Method = "scheduled",
    *,
    centre: float | None = None,
) -> Observer:
    """Design an observer whose error poles lie in a region for the whole family, and prove it.

    `place` on the dual plant (A(alpha)', C(alpha)'): A - L C and its transpose have one spectrum.

    Parameters
    ----------
    plant : UncertainPlant
    measured : sequence of str, (p, n) matrix or N of them
        Names of the measured states, as in ``plant.states``, with or without the unit in brackets;
        or C of y = C x; or one C for each vertex. Fractions stay exact.
    region : Region, optional
        As for `place`.
    method : str, Scheduled or Slack
        As for `place`. "quadratic" and "slack" give one L; "scheduled" gives L(alpha).
    centre : float, optional
        Instead of a region: the smallest disk about this centre [1/s] that the method reaches.

    Raises
    ------
    UnobservableError
        If a vertex has a pole that is not seen and not in the region (without one, not stable);
        the message says what is not seen and what to measure.
    NotProvedError
        If the region is not proved; for a disk, its ``best`` is the `Observer` of the smallest
        disk of this centre that is.
    InputError
        If ``measured`` does not fit the plant, or not exactly one of region and centre is given.
    """
    if not isinstance(plant, UncertainPlant):
        given = type(plant).__name__
        raise InputError(f"plant must be of type UncertainPlant, not {given}; load(path) reads one")
    if (region is None) == (centre is None):
        raise InputError("give a region, or a centre for the smallest disk, and not both")
    plant.require_on_time(
        "of which no observer is proved", "leave out [dead_time], and observe the rest"
    )
    C, names = read_measured(plant, measured)
    region = None if region is None else in_time_of(plant, region)
    require_observable(plant, C, names, region)
    dual = dual_plant(plant, C, names)
    try:
        if region is None:
            return Observer(plant, _marked(tightest(dual, centre, method), plant))
        return Observer(plant, _marked(place(dual, region, method), plant))
    except NotProvedError as answer:
        best = None if answer.best is None else Observer(plant, _marked(answer.best, plant))
        raise NotProvedError(str(answer), best) from answer


def _marked(design: Design, plant: UncertainPlant) -> Design:
    """Return the design of the dual plant as that of the plant's observer."""
    return replace(design, certificate=replace(design.certificate, observed=plant))


@dataclass(frozen=True, eq=False, repr=False)
class Observer(Short):
    """x^' = A x^ + B u + L (y - C x^), with the design of the dual plant that proves its poles.

    A and B are those of the plant at alpha, so alpha is needed to run it even where L is fixed.

    Attributes
    ----------
    plant : UncertainPlant
        The plant observed.
    design : Design
        State feedback of the dual plant (A', C') with the gain -L'.

    Raises
    ------
    InputError
        If the design is not one of the plant's dual.
    """

    plant: UncertainPlant
    design: Design

    @explained_fields
    def __post_init__(self) -> None:
        require_kind(self.design.certificate, observer=True)
        dual, plant = self.design.plant, self.plant
        matrices = [transposed(v.exact_A) for v in dual.vertices]
        of_plant = [v.exact_A for v in plant.vertices]
        same = matrices == of_plant and dual.sample_time == plant.sample_time
        near = plant.remainder and plant.remainder.transposed(*dual.shape)
        if not same or dual.remainder != near or not _same_parameters(dual, plant):
            raise InputError(
                f"the design is not an observer's of {plant.name}: {dual.name} has other matrices "
                "or parameters; design one with observe(plant, ...)"
            )

    def __repr__(self) -> str:
        status = "proved" if self.design.proved else "not proved"
        method, region = self.design.method, self.design.region
        return f"<Observer of {self.plant.name!r}: {method}, {region}, {status}>"

    @property
    def exact_C(self) -> tuple[Exact, ...]:
        """Measurement matrix of every vertex, N of (p, n) rationals."""
        return tuple(transposed(v.exact_B) for v in self.design.plant.vertices)

    @cached_property
    def C(self) -> Array:
        """Vertex measurement matrices, (N, p, n)."""
        return np.swapaxes(self.design.plant.B, -1, -2)

    @property
    def region(self) -> Region:
        """The region that holds all poles of the error."""
        return self.design.region

    def gain(self, alpha: Any = None, clamp: bool = False) -> Array:
        """Return L(alpha), (..., n, p) for alpha (..., N); a fixed gain needs no alpha.

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex by more than rounding, unless ``clamp``.
        """
        return -np.swapaxes(self.design.law.gain(alpha, clamp), -1, -2)

    def gain_at(self, clamp: bool = False, **values: Any) -> Array:
        """Return L at physical parameter values, for example ``gain_at(m1=300, beta=0)``.

        Raises
        ------
        ParameterValueError
            If a value is missing, unknown, or outside its interval (unless ``clamp``).
        """
        return -np.swapaxes(self.design.law.gain_at(clamp, **values), -1, -2)

    def poles(self, alpha: Any) -> Array:
        """Poles of the error, those of A - L C, at alpha (..., N), as (..., n) complex."""
        return self.design.poles(check_alpha(alpha, len(self.plant.vertices)))

    def save(self, directory: str | Path) -> Path:
        """Write ``design.json`` into a folder, made if need be; return its path.

        ``polefence check`` proves it afresh. It holds the plant, and a claim of kind "observer":
        what is measured, and the law -L' of the plant (A', C').

        Raises
        ------
        OutputError
            If the folder cannot be written; nothing is left half-written.
        """
        return self.design.save(directory)

    @classmethod
    def load(cls, path: str | Path, plant: UncertainPlant, measured: Any) -> Observer:
        """Read an observer's design file, prove it afresh, and hold it against plant and sensors.

        Raises
        ------
        DesignFileError
            If it cannot be read.
        NotProvedError
            If its claim is not proved.
        InputError
            If it is about another plant, or other measurements.
        """
        design = Design.load(path, observer=True)
        try:
            observer = cls(plant, design)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        if observer.exact_C != read_measured(plant, measured)[0]:
            raise InputError(f"{path}: an observer from other measurements; design it afresh")
        return observer

    def feedback(self, design: Design) -> OutputFeedback:
        """Return the output feedback u = K x^ with a state-feedback design of the same plant.

        Raises
        ------
        InputError
            If the design is of another plant.
        """
        return OutputFeedback(self, design)


@dataclass(frozen=True, eq=False, repr=False)
class OutputFeedback(Short):
    """Observer-based state feedback, u = K x^: the poles are those of A + B K and of A - L C.

    Attributes
    ----------
    observer : Observer
    design : Design
        State feedback of the same plant.

    Raises
    ------
    InputError
        If the design is of another plant.
    """

    observer: Observer
    design: Design

    @explained_fields
    def __post_init__(self) -> None:
        if not isinstance(self.design, Design):
            raise InputError(f"feedback takes a Design, not {type(self.design).__name__}")
        ours, theirs = self.observer.plant, self.design.plant
        if ours.digest != theirs.digest or not _same_parameters(ours, theirs):
            raise InputError(
                f"the state feedback is of another plant ({theirs.name}) than the observer "
                f"({ours.name}); design both for one"
            )

    def __repr__(self) -> str:
        return f"<OutputFeedback of {self.observer!r} and {self.design!r}>"

    def compensator(self, alpha: Any) -> tuple[Array, Array, Array]:
        """Return Ac, Bc, Cc of xc' = Ac xc + Bc y, u = Cc xc, batched over alpha (..., N)."""
        return _compensator(*self._matrices(alpha))

    def closed_loop(self, alpha: Any) -> Array:
        """Return the loop's matrix in the coordinates (x, xc), (..., 2 n, 2 n)."""
        return np.asarray(_closed_loop(*self._matrices(alpha)))

    def poles(self, alpha: Any) -> Array:
        """Closed-loop poles, (..., 2 n) complex, from the whole matrix `closed_loop`."""
        return np.asarray(np.linalg.eigvals(self.closed_loop(alpha)))

    def separation(self, alpha: Any) -> float:
        """Return how far the poles lie from those of A + B K and A - L C: zero but for rounding.

        The largest distance over alpha (..., N), poles matched one to one; relative to the pole's
        own magnitude, in discrete time absolute.
        """
        from scipy.optimize import linear_sum_assignment  # slow to import

        apart = np.concatenate([self.design.poles(alpha), self.observer.poles(alpha)], axis=-1)
        discrete = self.observer.plant.sample_time is not None
        scale = np.where((apart == 0) | discrete, 1.0, np.abs(apart))
        cost = np.abs(self.poles(alpha)[..., :, None] - apart[..., None, :]) / scale[..., None, :]
        tables = cost.reshape(-1, *cost.shape[-2:])
        return float(max(table[linear_sum_assignment(table)].max() for table in tables))

    def separates(self, alpha: Any) -> bool:
        """Decide exactly whether the loop, in the coordinates (x, x - xc), is block triangular.

        Its diagonal blocks must equal A + B K and A - L C. ``alpha`` is N rationals of sum one; the
        gains are those computed at it, taken as the rationals that floats are.
        """
        weights = [Fraction(a) for a in alpha]
        floats = [float(a) for a in weights]
        L, K = self.observer.gain(floats), self.design.law.gain(floats)
        plant, n = self.observer.plant, self.observer.plant.shape[0]
        A, B, C = (
            sum(a * np.array(M, dtype=object) for a, M in zip(weights, matrices, strict=True))
            for matrices in (
                [v.exact_A for v in plant.vertices],
                [v.exact_B for v in plant.vertices],
                self.observer.exact_C,
            )
        )
        parts = (A, B, C, *(np.vectorize(Fraction, otypes=[object])(M) for M in (K, L)))
        one, zero = np.eye(n, dtype=int).astype(object), np.zeros((n, n), dtype=int).astype(object)
        T = np.block([[one, zero], [one, -one]])  # its own inverse
        loop = T @ _closed_loop(*parts) @ T
        _, _, _, K, L = parts
        return bool(
            np.all(loop[n:, :n] == 0)
            and np.all(loop[:n, :n] == A + B @ K)
            and np.all(loop[n:, n:] == A - L @ C)
        )

    def _matrices(self, alpha: Any) -> tuple[Array, Array, Array, Array, Array]:
        a = check_alpha(alpha, len(self.observer.plant.vertices))
        A, B = self.observer.plant.at(a)
        C = np.tensordot(a, self.observer.C, 1)
        return A, B, C, self.design.law.gain(a), self.observer.gain(a)


def _compensator(A: Any, B: Any, C: Any, K: Any, L: Any) -> tuple[Any, Any, Any]:
    return A + B @ K - L @ C, L, K


def _closed_loop(A: Any, B: Any, C: Any, K: Any, L: Any) -> Any:
    """Assemble plant and compensator; of floats, batched, or of rationals."""
    Ac, Bc, Cc = _compensator(A, B, C, K, L)
    return np.block([[A, B @ Cc], [Bc @ C, Ac]])


def _same_parameters(one: UncertainPlant, other: UncertainPlant) -> bool:
    ours, theirs = (
        [(p.name, p.low, p.high, p.through) for p in plant.parameters] for plant in (one, other)
    )
    return ours == theirs
