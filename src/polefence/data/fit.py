"""A family fitted to measurements: a black box whose coefficients are polynomials in parameters.

It begins with a model of each point of the parameters (vector fitting), whose coefficients are
spread over all points; then all measurements are fitted together (Levenberg and Marquardt): the
relative error of frequency responses, the output error of responses in time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, suggest
from polefence.base.explained import explained
from polefence.base.files import write_text
from polefence.base.progress import counted, stage
from polefence.data.linear import transfer
from polefence.data.local import Model, Signals, local_model, sizes
from polefence.data.measured import FrequencyResponse, Measurement, Response, measured
from polefence.data.read_back import model_at
from polefence.data.residual import Missed, Residual, misfits, missed, rest
from polefence.data.shape import Basis, Shape, chains_of, spread
from polefence.data.written import Labels, black_box
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import split
from polefence.plant.parameters import Parameter, check_label, exact
from polefence.plant.spec import data_lines, loads
from polefence.plant.system import Array
from polefence.proof.fitted import TIME, Data, Misfit
from polefence.proof.short import Short
from polefence.proof.text import digits_up, plural

MOST_ORDER, MOST_DEGREE = 12, 2
MOST_MEASUREMENTS, MOST_SIGNALS, MOST_PARAMETERS = 100, 20, 3
MOST_ROWS = 30_000_000  # numbers of a matrix of slopes
MOST_WORK = 1_000_000_000  # of these, for all fits
TRIES = 50  # evaluations of one fit
SINGULAR = 1e-9  # of slopes of unit length: below that the data do not tell coefficients apart


@dataclass(frozen=True, eq=False, repr=False)
class Identified(Short):
    """A family fitted to measurements, and what it misses them by.

    Attributes
    ----------
    plant : UncertainPlant
        With ``data``: whatever is said of it says that this is unproved.
    text : str
        Its spec.
    measurements : tuple of Measurement
    inputs, outputs : tuple of str
        Names of what acts, and of what is measured.
    unknowns : int
        How many coefficients were sought.
    values : tuple of mapping
        For each measurement the values of the parameters that the family has it at.
    missed : tuple of Misfit
        Of each measurement.
    """

    plant: UncertainPlant
    text: str
    measurements: tuple[Measurement, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    unknowns: int
    values: tuple[Mapping[str, float], ...]
    missed: tuple[Misfit, ...]

    @property
    def data(self) -> Data:
        """What it was fitted to, and what it misses that by."""
        if self.plant.data is None:
            raise PlantError(f"{self.plant.name} is not from data")
        return self.plant.data

    def __str__(self) -> str:
        return self.data.note

    def __repr__(self) -> str:
        return f"<Identified {self.plant!r}, {self.data.all.text}>"

    @explained
    def response(self, number: int) -> Array:
        """Return what the family says in place of a measurement, from 0.

        Returns
        -------
        (p, count) or (p, m, count) array
            Of ``outputs``, in time with the initial state and the constants that miss it least; of
            a frequency response from ``inputs``, complex.
        """
        own = self.measurements[number]
        model = model_at(self.plant, self._signals, self.values[number])
        if isinstance(own, FrequencyResponse):
            return np.asarray(transfer(model.A, model.B, model.C, model.D, own.frequency))
        left = rest(self._signals, model, own)
        y = self._signals.sampled(own)[1]
        return np.full_like(y, np.nan) if left is None else y - left

    def measured(self, number: int) -> Array:
        """Return a measurement in the same order, from 0; nan where a pair was not measured."""
        own = self.measurements[number]
        if isinstance(own, FrequencyResponse):
            return self._signals.values(own)
        return self._signals.sampled(own)[1]

    @property
    def _signals(self) -> Signals:
        none = np.zeros((len(self.outputs), len(self.inputs)), dtype=bool)
        return Signals(self.inputs, self.outputs, none, self.plant.shape[0])

    @explained
    def save(self, path: str | Path) -> Path:
        """Write the spec, which every command and `load` read; return its path.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        path = Path(path)
        write_text(path, self.text)
        return path


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
    def samples(self) -> int:
        """How many instants or frequencies there are."""
        return sum(own.count for own in self.measurements)

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
        if self.signals.unstable and self.measurements[0].kind == TIME:
            raise InputError(
                "an unstable plant is fitted to frequency responses alone: its response in time "
                "grows; measure its frequency response in a closed loop"
            )
        points = [
            dict(zip((p.name for p in self.parameters), at, strict=True)) for at in self.groups
        ]
        M = np.array([self.basis.at(point) for point in points])
        if np.linalg.matrix_rank(M) < M.shape[1]:
            raise InputError(
                f"{plural(len(points), 'point')} of the parameters cannot tell the "
                f"{M.shape[1]} terms of degree {self.degree} apart; measure at more values, or ask "
                "for a lower degree"
            )
        self._require_bounded(M.shape[1])

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
        unknowns = self.entries * monomials
        known = self._numbers
        if known < 2 * unknowns:
            raise InputError(
                f"{known} measured numbers are too few for {unknowns} coefficients; measure more, "
                "or ask for a lower order or degree"
            )
        work = known * unknowns * (len(self.groups) + 1)
        if known * unknowns > MOST_ROWS or work > MOST_WORK:
            most = min(MOST_ROWS // unknowns, MOST_WORK // (unknowns * (len(self.groups) + 1)))
            raise InputError(
                f"{known} measured numbers and {unknowns} coefficients are more than are fitted "
                f"here; thin the samples out to {most} numbers, or ask for a lower order"
            )

    @property
    def _numbers(self) -> int:
        """How many numbers were measured."""
        total = 0
        for own in self.measurements:
            if isinstance(own, FrequencyResponse):
                total += 2 * int((~np.isnan(self.signals.values(own))).sum())
            else:
                total += len(self.signals.outputs) * own.count
        return total

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
            theta = self.fitted(shape, scale, start, self.measurements)
        self._require_stable(shape, theta)
        left_out = self._left_out(shape, scale, theta)
        text = black_box(shape, self.basis, theta, labels)
        return self.read_back(text, left_out, theta.size)

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
            residual = Residual(self.signals, shape.places, scale)
            r = self.residual(residual, shape, theta, self.measurements)
            cost = float(np.linalg.norm(r))
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = cost, shape, theta
        if best is None:
            raise InputError(
                f"the measurements do not determine a model of order {self.signals.order}; ask for "
                "a lower order"
            )
        return best[1], best[2]

    def residual(
        self, of: Residual, shape: Shape, theta: Array, measurements: Sequence[Measurement]
    ) -> Array:
        """Return the residual of measurements."""
        rows = (of.of(shape.model(theta @ self.basis.at(own.at)), own) for own in measurements)
        return np.concatenate(list(rows))

    def slopes(
        self, of: Residual, shape: Shape, theta: Array, measurements: Sequence[Measurement]
    ) -> Array:
        """Return its slopes in the coefficients."""
        rows = list[Array]()
        for own in measurements:
            monomials = self.basis.at(own.at)
            J = of.slopes(shape.model(theta @ monomials), own)
            rows.append((J[:, :, None] * monomials).reshape(len(J), -1))
        return np.concatenate(rows)

    def fitted(
        self,
        shape: Shape,
        scale: Array | None,
        start: Array,
        measurements: Sequence[Measurement],
    ) -> Array:
        """Return the coefficients that fit measurements best, near others.

        Raises
        ------
        InputError
            If the measurements do not determine them.
        """
        from scipy.optimize import least_squares  # deferred: slow to import

        of = Residual(self.signals, shape.places, scale)

        def fun(x: Array) -> Array:
            return self.residual(of, shape, x.reshape(start.shape), measurements)

        def jac(x: Array) -> Array:
            return self.slopes(of, shape, x.reshape(start.shape), measurements)

        found = least_squares(
            fun, start.reshape(-1), jac, method="lm", x_scale="jac", max_nfev=TRIES,
            xtol=1e-9, ftol=1e-9, gtol=1e-12,
        )  # fmt: skip
        if not determined(np.asarray(found.jac), SINGULAR):
            raise InputError(
                f"the measurements do not determine the {start.size} coefficients of order "
                f"{self.signals.order} and degree {self.degree}; ask for a lower order or degree"
            )
        return np.asarray(found.x.reshape(start.shape))

    def _require_stable(self, shape: Shape, theta: Array) -> None:
        """Refuse a family that is unstable where the plant was not said to be."""
        if self.signals.unstable:
            return
        for point in points_of(self.parameters):
            pole = max(np.linalg.eigvals(shape.model(theta @ self.basis.at(point)).A).real)
            if pole >= 0:
                where = ", ".join(f"{key} = {value:g}" for key, value in point.items())
                raise InputError(
                    f"the fit is unstable{f' at {where}' if where else ''}, with a pole at "
                    f"{pole:.3g}; ask for another order or degree, or say unstable = true "
                    "if the plant itself is"
                )

    def _left_out(self, shape: Shape, scale: Array | None, theta: Array) -> list[Missed]:
        """Return what fits of all other measurements miss each by; none of fewer than three."""
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
            M = np.array([self.basis.at(own.at) for own in others.measurements])
            if np.linalg.matrix_rank(M) < M.shape[1]:
                return []
            known = others.fitted(shape, scale, theta, others.measurements)
            model = shape.model(known @ self.basis.at(group[0].at))
            found += [missed(self.signals, model, own, scale) for own in group]
        return found

    def read_back(self, text: str, left_out: Sequence[Missed], unknowns: int) -> Identified:
        """Return the family of a spec, with what it misses the measurements by."""
        return with_data(
            text, self.signals, self.measurements, [own.at for own in self.measurements],
            left_out, unknowns,
        )  # fmt: skip


def determined(J: Array, least: float) -> bool:
    """Whether slopes, each of unit length, tell all unknowns apart."""
    size = np.linalg.norm(J, axis=0)
    if not size.min() > 0:
        return False
    s = np.linalg.svd(J / size, compute_uv=False)
    return bool(s[-1] > least * s[0])


def points_of(parameters: Sequence[Parameter]) -> Iterator[dict[str, float]]:
    """Yield points of a box: a grid of five values of each parameter."""
    axes = [np.linspace(float(p.low), float(p.high), 5) for p in parameters]
    for values in np.array(np.meshgrid(*axes)).reshape(len(axes), -1).T if axes else [()]:
        yield {p.name: float(value) for p, value in zip(parameters, values, strict=True)}


def scale_of(signals: Signals, measurements: Sequence[Measurement]) -> Array | None:
    """Return the sizes of outputs in time; None of frequency responses."""
    if measurements[0].kind != TIME:
        return None
    scale = sizes(signals, measurements)
    for size, name in zip(scale, signals.outputs, strict=True):
        if not size > 0:
            raise InputError(f"output {name!r} does not move in any measurement; leave it out")
    return scale


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


def with_data(
    text: str,
    signals: Signals,
    measurements: Sequence[Measurement],
    values: Sequence[Mapping[str, float]],
    left_out: Sequence[Missed],
    unknowns: int,
) -> Identified:
    """Return the family that a spec says, and the spec with what it misses measurements by.

    The plant is read back from the text, so that the misfit is that of what is written.
    """
    plant, scale = loads(text), scale_of(signals, measurements)
    found = [
        missed(signals, model_at(plant, signals, at), own, scale)
        for own, at in zip(measurements, values, strict=True)
    ]
    every, outputs, place = misfits(signals, found)
    data = Data(
        measurements[0].kind,
        tuple(own.name for own in measurements),
        sum(own.count for own in measurements),
        _rounded(every),
        tuple((name, _rounded(own)) for name, own in outputs),
        place,
        _rounded(misfits(signals, left_out)[0]) if left_out else None,
    )
    text = text + "\n".join(data_lines(data)) + "\n"
    each = tuple(misfits(signals, [one])[0] for one in found)
    return Identified(
        loads(text), text, tuple(measurements), signals.inputs, signals.outputs, unknowns,
        tuple(values), each,
    )  # fmt: skip


def _rounded(misfit: Misfit) -> Misfit:
    """Return it with three digits, rounded up."""
    return Misfit(*(float(digits_up(value, 3)) for value in (misfit.rms, misfit.largest)))
