"""A family fitted to measurements: a black box whose coefficients are polynomials in parameters.

It begins with a model of each point of the parameters (vector fitting), whose coefficients are
spread over all points; then all measurements are fitted together (Levenberg and Marquardt): the
relative error of frequency responses, the output error of responses in time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained
from polefence.base.processors import small_matrices
from polefence.base.progress import counted, stage
from polefence.data.identified import Identified, scale_of, with_data
from polefence.data.local import Model, Signals, local_model
from polefence.data.measured import FrequencyResponse, Measurement, Response, measured
from polefence.data.residual import Missed, Residual, missed
from polefence.data.search import Search
from polefence.data.shape import Basis, Shape, chains_of, spread
from polefence.data.written import Labels, black_box
from polefence.plant.outputs import split
from polefence.plant.parameters import Parameter, check_label, exact
from polefence.plant.system import Array
from polefence.proof.fitted import TIME
from polefence.proof.text import plural

MOST_ORDER, MOST_DEGREE = 12, 2
MOST_MEASUREMENTS, MOST_SIGNALS, MOST_PARAMETERS = 100, 20, 3
MOST_ROWS = 30_000_000  # numbers of a matrix of slopes
MOST_WORK = 1_000_000_000  # of slopes of measured numbers in entries, for all fits: some minutes
CHEAP = 25  # steps of a factorisation that take the time of one such slope


@explained
def identify(
    measurements: Sequence[Any],
    order: int,
    degree: int = 1,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    disturbances: Sequence[str] = (),
    direct: Sequence[str] = (),
    parameters: Sequence[Parameter] = (),
    unstable: bool = False,
    name: str = "plant",
) -> Identified:
    """Fit a family to responses that were measured at known values of its parameters.

    Parameters
    ----------
    measurements : sequence of Response, FrequencyResponse, or what `measured` takes
        All in time, or all frequency responses.
    order : int
        Number of states, at most 12.
    degree : int
        Of the coefficients, polynomials in the scheduling variables of the parameters: 0, 1 or 2.
    inputs, outputs, disturbances : sequence of str
        Names of signals of the measurements, with units: what a law sets, what is measured, and
        what acts besides.
    direct : sequence of str
        Outputs into which all inputs and disturbances pass straight, or "OUTPUT from INPUT", of one
        alone: "acceleration from force".
    parameters : sequence of Parameter
        Whose values the measurements have, from the least to the greatest; by default all that the
        measurements name.
    unstable : bool
        Whether the plant itself may be unstable: of frequency responses alone.
    name : str
        Of the family.

    Returns
    -------
    Identified
        ``str()`` of it says what is not proved, and what it misses the measurements by.

    Raises
    ------
    InputError
        If the measurements do not fit together, are too few, or tell of no such family.
    """
    responses = tuple(
        one if isinstance(one, Response | FrequencyResponse) else measured(one)
        for one in measurements
    )
    labels = Labels(name, tuple(inputs), tuple(disturbances), tuple(outputs))
    signals = signals_of(labels, direct, order, unstable)
    question = _Question(signals, responses, _box(responses, parameters), degree)
    question.require()
    with small_matrices():  # threads of BLAS that wait for one another took most of the time
        return question.answer(labels)


def signals_of(labels: Labels, direct: Sequence[str], order: int, unstable: bool) -> Signals:
    """Return the signals of a model.

    Raises
    ------
    InputError
        If names repeat, or are too many; or the order is none.
    """
    check_label(labels.name, "name")
    acting = tuple(split(label)[0] for label in (*labels.inputs, *labels.disturbances))
    measured_ = tuple(split(label)[0] for label in labels.outputs)
    for label in (*acting, *measured_):
        check_label(label, "name of a signal")
    if not labels.inputs or not measured_:
        raise InputError("name at least one input and one output")
    if len({*acting, *measured_}) < len(acting) + len(measured_):
        raise InputError("two signals have one name; rename one")
    if len(acting) > MOST_SIGNALS or len(measured_) > MOST_SIGNALS:
        raise InputError(f"at most {MOST_SIGNALS} inputs and {MOST_SIGNALS} outputs are fitted")
    if type(order) is not int or not 1 <= order <= MOST_ORDER:
        raise InputError(f"order = {order!r} must be a whole number from 1 to {MOST_ORDER}")
    return Signals(acting, measured_, _straight(direct, measured_, acting), order, unstable)


def _straight(direct: Sequence[str], outputs: tuple[str, ...], acting: tuple[str, ...]) -> Any:
    """Return which inputs pass straight into which outputs (p, m)."""
    passing = np.zeros((len(outputs), len(acting)), dtype=bool)
    pairs = {f"{output} from {inside}": (i, j) for i, output in enumerate(outputs)
             for j, inside in enumerate(acting)}  # fmt: skip
    for label in direct:
        own = " from ".join(split(part)[0] for part in label.split(" from "))
        if own in outputs:
            passing[outputs.index(own)] = True
        elif own in pairs:
            passing[pairs[own]] = True
        else:
            raise InputError(f"direct: {label!r} is no output; {suggest(own, [*outputs, *pairs])}")
    return passing


def _box(
    measurements: Sequence[Measurement], parameters: Sequence[Parameter]
) -> tuple[Parameter, ...]:
    """Return the parameters, by default all, from the least value to the greatest."""
    if parameters:
        return (parameters,) if isinstance(parameters, Parameter) else tuple(parameters)
    names = dict.fromkeys(name for own in measurements for name in own.at)
    return tuple(over_values(name, measurements) for name in names)


def over_values(name: str, measurements: Sequence[Measurement], **words: Any) -> Parameter:
    """Return a parameter from the least measured value to the greatest.

    Raises
    ------
    InputError
        If it has no value, or one value alone.
    """
    values = [own.at[name] for own in measurements if name in own.at]
    if len(set(values)) < 2:
        raise InputError(
            f"parameter {name}: measured at {f'{values[0]:g} alone' if values else 'no value'}; "
            "measure at another value too, or leave the parameter out"
        )
    low, high = (exact(repr(end), name) for end in (min(values), max(values)))
    return Parameter(name, low, high, **words)


@dataclass(frozen=True, eq=False)
class _Question:
    """What is sought."""

    signals: Signals
    measurements: tuple[Measurement, ...]
    parameters: tuple[Parameter, ...]
    degree: int

    @property
    def basis(self) -> Basis:
        """The monomials."""
        return Basis(self.parameters, self.degree if self.parameters else 0)

    @property
    def groups(self) -> dict[tuple[float, ...], list[Measurement]]:
        """Measurements at one point each."""
        found = dict[tuple[float, ...], list[Measurement]]()
        for own in self.measurements:
            found.setdefault(tuple(own.at[p.name] for p in self.parameters), []).append(own)
        return found

    @property
    def timed(self) -> bool:
        """Whether responses in time were measured."""
        return self.measurements[0].kind == TIME

    @property
    def entries(self) -> int:
        """How many entries are free."""
        n, m, p = self.signals.order, len(self.signals.inputs), len(self.signals.outputs)
        return n * (p + m) + int(self.signals.direct.sum())

    def require(self) -> None:
        """Refuse what does not fit together, is too little, or too much.

        Raises
        ------
        InputError
        """
        require_alike(self.signals, self.measurements)
        if self.degree not in range(MOST_DEGREE + 1):
            raise InputError(f"degree = {self.degree!r} must be 0, 1 or 2")
        if len(self.parameters) > MOST_PARAMETERS:
            raise InputError(f"{len(self.parameters)} parameters; at most {MOST_PARAMETERS}")
        for p in self.parameters:
            self._require_values(p)
        if self.signals.unstable and self.timed:
            raise InputError(
                "an unstable plant is fitted to frequency responses alone: its response in time "
                "grows; measure its frequency response in a closed loop"
            )
        terms = len(self.basis.powers)
        if not self._tells_terms:
            raise InputError(
                f"{plural(len(self.groups), 'point')} of the parameters cannot tell the {terms} "
                f"terms of degree {self.degree} apart; measure at more values, or ask for a lower "
                "degree"
            )
        self._require_bounded(terms)

    @property
    def _tells_terms(self) -> bool:
        """Whether the points tell the monomials apart."""
        M = np.array([self.basis.at(own.at) for own in self.measurements])
        return bool(np.linalg.matrix_rank(M) == M.shape[1])

    def _point(self, at: tuple[float, ...]) -> dict[str, float]:
        """Return values by the parameters' names."""
        return dict(zip((p.name for p in self.parameters), at, strict=True))

    def _require_values(self, p: Parameter) -> None:
        values = [own.at[p.name] for own in self.measurements if p.name in own.at]
        if len(values) < len(self.measurements):
            other = next(own for own in self.measurements if p.name not in own.at)
            raise InputError(f"{other.name}: at has no value of {p.name}")
        over_values(p.name, self.measurements)
        low, high = min(values), max(values)
        if (float(p.low), float(p.high)) != (low, high):
            raise InputError(
                f"parameter {p.name}: range = [{float(p.low):g}, {float(p.high):g}] is not what "
                f"was measured, {low:g} to {high:g}; give that, and narrow the range of the family"
            )

    def _require_bounded(self, monomials: int) -> None:
        each = [self._numbers(own) for own in self.measurements]
        entries, unknowns, known = self.entries, self.entries * monomials, sum(each)
        beside = len(each) * (self.signals.order + len(self.signals.outputs)) if self.timed else 0
        if known - beside < 2 * unknowns:
            more = f", and {beside} initial values and constants" if beside else ""
            raise InputError(
                f"{known} measured numbers are too few for {unknowns} coefficients{more}; measure "
                "more, or ask for a lower order or degree"
            )
        fits = len(self.groups) + 1
        condensed = min(known, len(each) * (entries + 1)) * unknowns
        rest = MOST_WORK // fits - condensed * unknowns // CHEAP
        if condensed > MOST_ROWS or rest < 0:
            raise InputError(
                f"{plural(len(each), 'measurement')} and {unknowns} coefficients are more than are "
                "fitted here; ask for a lower order or degree"
            )
        most = min(rest // entries, MOST_ROWS // entries * known // max(each))
        if known > most:
            raise InputError(
                f"{known} measured numbers and {unknowns} coefficients are more than are fitted "
                f"here; thin the samples out to {most} numbers, or ask for a lower order"
            )

    def _numbers(self, own: Measurement) -> int:
        """Return how many numbers a measurement has."""
        if isinstance(own, FrequencyResponse):
            return 2 * int((~np.isnan(self.signals.values(own))).sum())
        return len(self.signals.outputs) * own.count

    def answer(self, labels: Labels) -> Identified:
        """Return the family.

        Raises
        ------
        InputError
            If there is none.
        """
        scale = scale_of(self.signals, self.measurements)
        with stage("a model of each point"):
            shape, start = self._start(scale)
        with stage("all measurements together"):
            theta, told = self._search(shape, scale).answer(start)
        if not told:
            raise InputError(
                f"the measurements do not determine the {theta.size} coefficients of order "
                f"{self.signals.order} and degree {self.degree}; ask for a lower order or degree"
            )
        self._require_stable(shape, theta)
        left_out = self._left_out(shape, scale, theta)
        return with_data(
            black_box(shape, self.basis, theta, labels), self.signals, self.measurements,
            [own.at for own in self.measurements], left_out, theta.size,
        )  # fmt: skip

    def _start(self, scale: Array | None) -> tuple[Shape, Array]:
        models, points = list[Model](), list[dict[str, float]]()
        for at, group in self.groups.items():
            model = local_model(self.signals, group, scale)
            if model is None:
                names = ", ".join(own.name for own in group)
                raise InputError(f"{names}: no model of order {self.signals.order} was found")
            models.append(model)
            points.append(self._point(at))
        speeds = [abs(pole) for model in models for pole in np.diag(model.A)]
        rate = float(f"{np.exp(np.mean(np.log(speeds))):.3g}")
        best: tuple[float, Shape, Array] | None = None
        for chains in chains_of(self.signals.order, len(self.signals.outputs)):
            shape = Shape(self.signals, chains, rate)
            rows = [shape.entries(model) for model in models]
            if any(row is None for row in rows):
                continue
            theta = spread(self.basis, points, np.array(rows))
            cost = self._search(shape, scale).cost(theta)
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = cost, shape, theta
        if best is None:
            raise InputError(
                f"the measurements do not determine a model of order {self.signals.order}; ask for "
                "a lower order"
            )
        return best[1], best[2]

    def _search(self, shape: Shape, scale: Array | None) -> Search:
        residual = Residual(self.signals, shape.places, scale)
        return Search(residual, shape, self.basis, self.measurements)

    def _require_stable(self, shape: Shape, theta: Array) -> None:
        """Refuse a family that is unstable where the plant was not said to be."""
        if self.signals.unstable:
            return
        # slower than what was measured it may as well be an integrator
        slowest = min(
            own.frequency[0] if isinstance(own, FrequencyResponse) else 1 / (own.count * own.step)
            for own in self.measurements
        )
        remedy = "" if self.timed else ", or say unstable = true if the plant itself is"
        for point in points_of(self.parameters):
            pole = max(np.linalg.eigvals(shape.model(theta @ self.basis.at(point)).A).real)
            if pole >= slowest:
                where = ", ".join(f"{key} = {value:g}" for key, value in point.items())
                raise InputError(
                    f"the fit is unstable{f' at {where}' if where else ''}, with a pole at "
                    f"{pole:.3g}; ask for another order or degree{remedy}"
                )

    def _left_out(self, shape: Shape, scale: Array | None, theta: Array) -> list[Missed]:
        """Return what fits of all other measurements miss each by.

        None of fewer than three points, or where the others do not tell all coefficients.
        """
        if len(self.groups) < 3 or not self.parameters:
            return []
        found = list[Missed]()
        for at, group in counted(self.groups.items(), "without measurement"):
            others = replace(
                self,
                measurements=tuple(
                    own for key, rest in self.groups.items() if key != at for own in rest
                ),
            )
            if not others._tells_terms:
                return []
            other, told = others._search(shape, scale).answer(theta)
            if not told:
                return []
            model = shape.model(other @ self.basis.at(group[0].at))
            found += [missed(self.signals, model, own, scale) for own in group]
        return found


def points_of(parameters: Sequence[Parameter]) -> Iterator[dict[str, float]]:
    """Yield points of a box: a grid of five values of each parameter."""
    axes = [np.linspace(float(p.low), float(p.high), 5) for p in parameters]
    for values in np.array(np.meshgrid(*axes)).reshape(len(axes), -1).T if axes else [()]:
        yield {p.name: float(value) for p, value in zip(parameters, values, strict=True)}


def require_alike(signals: Signals, measurements: Sequence[Measurement]) -> None:
    """Refuse measurements that are none, of two kinds, or without a signal.

    Raises
    ------
    InputError
    """
    if not 1 <= len(measurements) <= MOST_MEASUREMENTS:
        raise InputError(f"{len(measurements)} measurements; give 1 to {MOST_MEASUREMENTS}")
    if len({own.kind for own in measurements}) > 1:
        raise InputError(
            "responses in time and frequency responses are fitted apart; give one kind"
        )
    if len({own.name for own in measurements}) < len(measurements):
        raise InputError("two measurements have one name; name each after its file")
    for own in measurements:
        for what, asked, known in (
            ("input", signals.inputs, own.input_names),
            ("output", signals.outputs, own.output_names),
        ):
            for label in asked if own.kind == TIME else ():
                if label not in known:
                    raise InputError(f"{own.name}: {what} {label!r} is not among {list(known)}")
    if measurements[0].kind == TIME:
        return
    by_point = dict[tuple[tuple[str, float], ...], Any]()
    for own in measurements:
        if isinstance(own, FrequencyResponse):
            point = tuple(sorted(own.at.items()))
            seen = ~np.isnan(signals.values(own)).any(axis=2)
            by_point[point] = by_point.get(point, np.zeros_like(seen)) | seen
    for point, seen in by_point.items():
        if not seen.all():
            i, j = (int(k[0]) for k in np.nonzero(~seen))
            where = ", ".join(f"{key} = {value:g}" for key, value in point)
            raise InputError(
                f"no measurement{f' at {where}' if where else ''} has {signals.outputs[i]!r} from "
                f"{signals.inputs[j]!r}; measure it, or leave the signal out"
            )
