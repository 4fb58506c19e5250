"""Parameters of a spec that are unknown, sought in measurements: their ranges are what was found.

Each measurement has values of its own: those with which the plant of the spec misses it least. The
family takes the interval of these, wider by a margin that is stated.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, SpecError, suggest
from polefence.base.explained import explained
from polefence.base.files import read_text
from polefence.base.processors import small_matrices
from polefence.base.progress import counted
from polefence.data.fit import require_alike
from polefence.data.identified import Identified, scale_of, with_data
from polefence.data.local import Signals
from polefence.data.measured import FrequencyResponse, Measurement, Response, measured
from polefence.data.read_back import model_at
from polefence.data.residual import Missed, Residual, missed
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import split
from polefence.plant.spec import MAX_BYTES, loads
from polefence.plant.system import Array

MOST_UNKNOWN = 6
MOST_ROWS = 500_000  # numbers of all measurements
STARTS = 24  # points of the box that are looked at, beside its middle
BEST = 3  # of them, from which it is sought
TRIES = 60  # evaluations of one search
SINGULAR = 1e-7  # of slopes of unit length: below that the data do not tell unknowns apart
AT_END = 1e-6  # of a range: nearer to its end a value is not found but cut off
DIGITS = 6  # of the ends of a range, rounded outwards

Values = dict[str, float]


@explained
def refined_ranges(
    spec: str | Path,
    measurements: Sequence[Any],
    unknown: Sequence[str],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    margin: float = 0.0,
) -> Identified:
    """Find unknown parameters of a spec in measurements, and narrow their ranges to what is found.

    Parameters
    ----------
    spec : path
        With every unknown as a parameter, whose range is where it is sought.
    measurements : sequence of Response, FrequencyResponse, or what `measured` takes
        At values of all other parameters.
    unknown : sequence of str
        Names of parameters; each measurement gives one value of each.
    inputs, outputs : sequence of str
        Signals of the plant that acted, inputs or disturbances, and that were measured.
    margin : float
        Share of an end of a range by which it is moved outwards, as 0.05.

    Returns
    -------
    Identified
        With the spec as it was, but for the ranges and what it misses the measurements by.

    Raises
    ------
    InputError
        If the measurements do not tell the unknowns.
    """
    path = Path(spec)
    text = read_text(path, MAX_BYTES, SpecError)
    plant = loads(text, str(path))
    responses = tuple(
        one if isinstance(one, Response | FrequencyResponse) else measured(one)
        for one in measurements
    )
    acting, seen = (tuple(split(label)[0] for label in group) for group in (inputs, outputs))
    direct = np.ones((len(seen), len(acting)), dtype=bool)
    signals = Signals(acting, seen, direct, plant.shape[0], unstable=True)
    search = _Search(plant, signals, responses, tuple(unknown))
    search.require()
    if not (0 <= margin < 1):
        raise InputError(f"margin = {margin:g} must be a share, such as 0.05 of each end")
    if len(responses) == 1 and not margin:
        raise InputError("one measurement is one value, and no range; give a margin, such as 0.05")
    with small_matrices():
        return search.answer(text, path, margin)


class _Search:
    """The search for unknowns."""

    def __init__(
        self,
        plant: UncertainPlant,
        signals: Signals,
        measurements: tuple[Measurement, ...],
        unknown: tuple[str, ...],
    ) -> None:
        self.plant, self.signals = plant, signals
        self.measurements, self.unknown = measurements, unknown
        self.box = {p.name: p for p in plant.parameters}

    def require(self) -> None:
        """Refuse what does not fit the plant."""
        require_alike(self.signals, self.measurements)
        if not 1 <= len(self.unknown) <= MOST_UNKNOWN or len(set(self.unknown)) < len(self.unknown):
            raise InputError(f"unknown must name 1 to {MOST_UNKNOWN} parameters of the spec")
        if self.plant.sample_time is not None:
            raise InputError(
                f"{self.plant.name}: is in discrete time; give a plant in continuous time"
            )
        if self.plant.data is not None:
            raise InputError(
                f"{self.plant.name}: is from data already; give the spec without [data]"
            )
        for name in self.unknown:
            if name not in self.box:
                raise InputError(f"unknown: no parameter {name!r}; {suggest(name, self.box)}")
        for own in self.measurements:
            for name in self.box:
                if name not in self.unknown and name not in own.at:
                    raise InputError(
                        f"{own.name}: at has no value of {name}, which is not unknown; give it"
                    )
            for name in own.at:
                if name not in self.box or name in self.unknown:
                    raise InputError(f"{own.name}: at.{name} is no known parameter of the spec")
        numbers = sum(own.count for own in self.measurements) * len(self.signals.outputs)
        if numbers > MOST_ROWS:
            raise InputError(f"{numbers} measured numbers; at most {MOST_ROWS} are fitted here")

    def answer(self, text: str, path: Path, margin: float) -> Identified:
        """Return the family."""
        scale = scale_of(self.signals, self.measurements)
        ends = np.array([[float(self.box[k].low), float(self.box[k].high)] for k in self.unknown])
        found = list[Values]()
        for own in counted(self.measurements, "measurement"):
            values = self._best(own, scale, ends)
            self._require_inside(own, values, ends)
            found.append(values)
        ranges = self._ranges(found, margin, ends)
        left_out = self._left_out(found, margin, ends, scale)
        points = [
            {**own.at, **values} for own, values in zip(self.measurements, found, strict=True)
        ]
        written = with_ranges(text, str(path), ranges)
        return with_data(
            written, self.signals, self.measurements, points, left_out,
            len(self.unknown) * len(found),
        )  # fmt: skip

    def _best(self, own: Measurement, scale: Array | None, ends: Array) -> Values:
        """Return the values within ends with which the plant misses a measurement least."""
        from scipy.optimize import least_squares  # deferred: slow to import

        residual, width = Residual(self.signals, (), scale), ends[:, 1] - ends[:, 0]

        def at(z: Array) -> Values:
            share = np.clip(z, 0, 1)
            values = np.clip(ends[:, 0] + share * width, ends[:, 0], ends[:, 1])
            return dict(zip(self.unknown, values.tolist(), strict=True))

        def fun(z: Array) -> Array:
            return residual.of(self._model(own, at(z)), own)

        starts = [np.full(len(ends), 0.5), *_halton(STARTS, len(ends))]
        costs = [float(np.linalg.norm(fun(z))) for z in starts]
        tried = [
            least_squares(fun, starts[k], bounds=(0, 1), max_nfev=TRIES, xtol=1e-10, ftol=1e-10,
                          gtol=1e-12, x_scale="jac")
            for k in np.argsort(costs)[:BEST]
        ]  # fmt: skip
        best = min(tried, key=lambda one: float(one.cost))
        if not _determined(np.asarray(best.jac)):
            raise InputError(
                f"{own.name}: does not determine {', '.join(self.unknown)}: others explain it as "
                "well; measure other signals, or make one of them a constant"
            )
        return at(best.x)

    def _model(self, own: Measurement, values: Values) -> Any:
        return model_at(self.plant, self.signals, {**own.at, **values})

    def _require_inside(self, own: Measurement, values: Values, ends: Array) -> None:
        for (name, value), (low, high) in zip(values.items(), ends, strict=True):
            if min(value - low, high - value) <= AT_END * (high - low):
                raise InputError(
                    f"{own.name}: {name} = {value:g} is at the end of its range, [{low:g}, "
                    f"{high:g}], where it is sought; widen the range in the spec"
                )

    def _ranges(
        self, found: Sequence[Values], margin: float, ends: Array
    ) -> dict[str, tuple[float, float]]:
        """Return the ranges of what was found, within those of the spec."""
        ranges = dict[str, tuple[float, float]]()
        for name, (least, most) in zip(self.unknown, ends, strict=True):
            values = [one[name] for one in found]
            low, high = min(values), max(values)
            low = max(_outwards(low - margin * abs(low), -1), least)
            high = min(_outwards(high + margin * abs(high), 1), most)
            ranges[name] = float(low), float(high)
        return ranges

    def _left_out(
        self, found: Sequence[Values], margin: float, ends: Array, scale: Array | None
    ) -> list[Missed]:
        """Return what the ranges of all other measurements miss each by; none of fewer than 3."""
        if len(found) < 3:
            return []
        missing = list[Missed]()
        for k, own in counted(list(enumerate(self.measurements)), "without measurement"):
            others = [values for j, values in enumerate(found) if j != k]
            within = np.array(list(self._ranges(others, margin, ends).values()))
            values = self._best(own, scale, within)
            missing.append(missed(self.signals, self._model(own, values), own, scale))
        return missing


def _determined(J: Array) -> bool:
    """Whether slopes, each of unit length, tell all unknowns apart."""
    size = np.linalg.norm(J, axis=0)
    if not size.min() > 0:
        return False
    s = np.linalg.svd(J / size, compute_uv=False)
    return bool(s[-1] > SINGULAR * s[0])


def _outwards(value: float, sign: int) -> float:
    """Return a value in six digits, rounded outwards."""
    if value == 0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(abs(value))) + 1 - DIGITS)
    whole = np.ceil(value / unit) if sign > 0 else np.floor(value / unit)
    return float(f"{whole * unit:.{DIGITS}g}")


def _halton(count: int, size: int) -> list[Array]:
    """Return points spread over a box."""
    points = np.empty((count, size))
    for j, base in enumerate((2, 3, 5, 7, 11, 13)[:size]):
        for k in range(count):
            value, share, rest = 0.0, 1.0 / base, k + 1
            while rest:
                value, rest, share = value + share * (rest % base), rest // base, share / base
            points[k, j] = value
    return list(points)


def with_ranges(text: str, source: str, ranges: Mapping[str, tuple[float, float]]) -> str:
    """Return a spec with other ranges of parameters, and all else as it is.

    Raises
    ------
    InputError
        If a range does not stand on one line below its [parameter.NAME].
    """
    written = text if text.endswith("\n") else text + "\n"
    for name, (low, high) in ranges.items():
        heading = re.search(
            rf"(?m)^\[[ \t]*parameter[ \t]*\.[ \t]*{re.escape(name)}[ \t]*\]", written
        )
        begin = heading.end() if heading else len(written)
        end = re.search(r"(?m)^\[", written[begin:])
        stop = begin + end.start() if end else len(written)
        line = re.compile(r"(?m)^([ \t]*range[ \t]*=[ \t]*)\[[^\]\n#]*\]")
        table, count = line.subn(rf"\g<1>[{low!r}, {high!r}]", written[begin:stop], count=1)
        if not count:
            raise InputError(
                f"{source}: parameter {name}: its range is not found; write [parameter.{name}], "
                "and range = [LOW, HIGH] on a line of its own below it"
            )
        written = written[:begin] + table + written[stop:]
    expected = tomllib.loads(text)
    for name, (low, high) in ranges.items():
        expected["parameter"][name]["range"] = [low, high]
    if tomllib.loads(written) != expected:
        raise PlantError(
            f"{source}: its ranges cannot be replaced; write each on a line of its own"
        )
    return written
