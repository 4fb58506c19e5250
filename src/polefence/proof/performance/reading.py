"""Read a performance file: a design, and what is claimed about its signals; proves nothing.

``{"format": "polefence-performance", "version": 1, "design": {...}, "specifications": [...]}``, a
specification being ``{"kind", "name", "output": {"C", "D"}, "level", "evidence": {...}, ...}``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from polefence.proof import placement
from polefence.proof.matrices import Rationals
from polefence.proof.performance.claims import (
    MAX_POINTS,
    Baseline,
    EnergyPeak,
    Gain,
    GainNorm,
    InitialPeak,
    Output,
    PerformanceClaim,
    RelativeRms,
    Rms,
    Subject,
)
from polefence.proof.performance.passive import baseline_loop
from polefence.proof.placement import Claim, Evidence, read_document, read_evidence
from polefence.proof.reading import (
    MAX_SIZE,
    MAX_VERTICES,
    _at,
    _integer,
    _list,
    _matrix,
    _only,
    _shape,
    read_matrix,
    read_number,
)
from polefence.proof.work import FormatError

FORMAT = "polefence-performance"
MAX_SPECIFICATIONS = 64
_COMMON = {"kind", "name", "output", "level", "evidence"}
_KEYS = {
    "rms": {"intensity"},
    "energy peak": {"norm"},
    "initial peak": {"points", "impulses", "ellipsoid"},
    "gain": set[str](),
    "relative rms": {"intensity", "baseline"},
    "gain norm": {"rows", "columns"},
}


def read_performance(text: str) -> tuple[list[PerformanceClaim], dict[str, Any]]:
    """Parse a performance file; return its claims, in their order, and the whole document.

    The design's own claim, about its region, is `exact.read`'s of ``document["design"]``.

    Raises
    ------
    FormatError
        If it is no JSON, cut short, of another format or version, or its shapes do not fit.
    """
    document = read_document(text, FORMAT)
    known = {"format", "version", "polefence", "design", "specifications"}
    _only({"file": document}, "file", known)
    try:
        # the one reader of designs reads this one too
        design, own = placement.read(json.dumps(_at(document, "design"), allow_nan=False))
    except (RecursionError, ValueError) as error:
        raise FormatError(f"design: {error}") from error
    if own["plant"].get("sample_time") is not None:
        raise FormatError("design: these are claims about plants in continuous time")
    E = _disturbance(own["plant"]["vertices"], len(design.A[0]))
    tables = _list(_at(document, "specifications"), "specifications", MAX_SPECIFICATIONS)
    claims = [
        _claim(_Entry(table, f"specifications[{k + 1}]"), design, E, own["plant"])
        for k, table in enumerate(tables)
    ]
    return claims, document


def _disturbance(vertices: list[dict[str, Any]], n: int) -> list[Rationals]:
    """Return E of all vertices, nothing where none has one."""
    if not any("E" in vertex for vertex in vertices):
        return []
    found = [_matrix(_at(v, "E"), f"vertex {j + 1}: E") for j, v in enumerate(vertices)]
    for j, E in enumerate(found):
        _shape(E, n, len(found[0][0]), f"vertex {j + 1}: E")
    return found


@dataclass(frozen=True)
class _Entry:
    """A table of the file, and where it is."""

    table: Any
    where: str

    def at(self, key: str) -> Any:
        return _at({self.where: self.table}, self.where, key)

    def only(self, known: set[str]) -> None:
        _only({self.where: self.table}, self.where, known)

    def below(self, key: str) -> _Entry:
        found = _Entry(self.at(key), f"{self.where}.{key}")
        if not isinstance(found.table, dict):
            raise FormatError(f"{found.where} must be a table")
        return found

    def number(self, key: str, default: int | None = None) -> Fraction:
        if default is not None and key not in self.table:
            return Fraction(default)
        return read_number(self.at(key), f"{self.where}.{key}")

    def numbers(self, key: str, count: int) -> tuple[Fraction, ...]:
        values = _list(self.at(key), f"{self.where}.{key}", MAX_SIZE)
        if len(values) != count:
            raise FormatError(f"{self.where}.{key} must hold {count} numbers")
        return tuple(read_number(value, f"{self.where}.{key}") for value in values)

    def rows(self, key: str, width: int, count: int) -> list[Rationals]:
        """Return one row a vertex, of which the file may hold one for all."""
        where = f"{self.where}.{key}"
        values = _list(self.at(key), where, MAX_VERTICES)
        if len(values) not in (1, count):
            raise FormatError(f"{where} must hold one row, or {count}: one a vertex")
        found = [read_matrix([row], where, 1, width) for row in values]
        return found * count if len(found) < count else found


def _claim(
    entry: _Entry, design: Claim, E: list[Rationals], plant: dict[str, Any]
) -> PerformanceClaim:
    kind = entry.at("kind")
    if not isinstance(kind, str) or kind not in _KEYS:
        raise FormatError(f"{entry.where}.kind must be one of {', '.join(_KEYS)}")
    entry.only((_COMMON - {"output"} if kind == "gain norm" else _COMMON) | _KEYS[kind])
    name = entry.table.get("name", "")
    if not isinstance(name, str):
        raise FormatError(f"{entry.where}.name must be text")
    N, n, m = len(design.A), len(design.A[0]), len(design.B[0][0])
    if kind not in ("initial peak", "gain norm") and not E:
        raise FormatError(f"{entry.where}: the plant has no E: no disturbance acts on it")
    if kind == "gain norm":
        return _gain_norm(entry, design, E, plant.get("parameters"))
    evidence, on = _evidence(entry.below("evidence"), design)
    placement.require_box(replace(design, on=on), plant.get("parameters"))
    table = entry.below("output")
    table.only({"C", "D", "F"} if kind == "gain" else {"C", "D"})
    C = table.rows("C", n, N)
    zero = [[[Fraction(0)] * m]] * N
    D = table.rows("D", m, N) if "D" in table.table else zero
    subject = Subject(design.A, design.B, E, design.law, evidence, on)
    return _READERS[kind](subject, Output(C, D, name), entry)


def _evidence(entry: _Entry, design: Claim) -> tuple[Evidence, str]:
    """Return the evidence, and whether it is about the simplex or the box."""
    own = "own" in entry.table
    fixed = design.law.K is not None
    known = {"own", "scale"} if own else {"X", "degree"} | (set() if fixed else {"multiple"})
    entry.only(known | {"elevation"} | ({"on"} if fixed else set()))
    on = design.on
    if fixed:
        on = placement._domain(entry.table.get("on", on), f"{entry.where}.on")
    n = len(design.A[0])
    if not own:
        sizes = placement.simplices(replace(design, on=on))
        return read_evidence(entry.table, entry.where, "X", n, sizes), on
    if entry.table["own"] is not True:
        raise FormatError(f"{entry.where}.own must be true")
    scale = entry.number("scale", 1)
    elevation = _integer(entry.table, entry.where, "elevation", 0)
    if design.method == "scheduled":
        return Evidence([], elevation=elevation, multiple=(scale,)), on
    if design.method != "quadratic":
        raise FormatError(f"{entry.where}.own: the method {design.method} has no W of its own")
    W = [[scale * x for x in row] for row in design.evidence[0].X[0]]
    return Evidence([W], elevation=elevation), on


def _gain_norm(entry: _Entry, design: Claim, E: list[Rationals], parameters: Any) -> GainNorm:
    below, fixed, on = entry.below("evidence"), design.law.K is not None, design.on
    below.only({"elevation", "on"} if fixed else {"elevation"})
    if fixed:
        on = placement._domain(below.table.get("on", on), f"{below.where}.on")
    placement.require_box(replace(design, on=on), parameters)
    evidence = Evidence([], elevation=_integer(below.table, below.where, "elevation", 0))
    subject = Subject(design.A, design.B, E, design.law, evidence, on)
    n, m = len(design.A[0]), len(design.B[0][0])
    rows, columns = entry.numbers("rows", m), entry.numbers("columns", n)
    return GainNorm(subject, entry.number("level"), rows, columns)


def _rms(subject: Subject, output: Output, entry: _Entry) -> Rms:
    return Rms(subject, output, entry.number("level"), entry.number("intensity", 1))


def _energy(subject: Subject, output: Output, entry: _Entry) -> EnergyPeak:
    return EnergyPeak(subject, output, entry.number("level"), entry.number("norm", 1))


def _initial(subject: Subject, output: Output, entry: _Entry) -> InitialPeak:
    points, impulses = list[tuple[Fraction, ...]](), tuple[Fraction, ...]()
    if "points" in entry.table:
        where = f"{entry.where}.points"
        for row in _list(entry.at("points"), where, MAX_POINTS):
            points.append(tuple(read_matrix([row], where, 1, len(subject.A[0]))[0]))
    if "impulses" in entry.table:
        if not subject.E:
            raise FormatError(f"{entry.where}.impulses: the plant has no E")
        impulses = entry.numbers("impulses", len(subject.E[0][0]))
    ellipsoid: list[tuple[Fraction, ...]] = []
    if "ellipsoid" in entry.table:
        where, n = f"{entry.where}.ellipsoid", len(subject.A[0])
        ellipsoid = list(map(tuple, read_matrix(entry.at("ellipsoid"), where, n, n)))
    level = entry.number("level")
    return InitialPeak(subject, output, level, tuple(points), impulses, tuple(ellipsoid))


def _gain(subject: Subject, output: Output, entry: _Entry) -> Gain:
    table, F = entry.below("output"), list[Rationals]()
    if "F" in table.table:
        F = table.rows("F", len(subject.E[0][0]), len(subject.A))
    return Gain(subject, output, entry.number("level"), tuple(F))


def _relative(subject: Subject, output: Output, entry: _Entry) -> RelativeRms:
    table = entry.below("baseline")
    table.only({"K", "states", "stability", "covariance"})
    n, m = len(subject.A[0]), len(subject.B[0][0])
    K, states = None, list(range(1, n + 1))
    if "K" in table.table:
        K = read_matrix(table.at("K"), f"{table.where}.K", m, n)
    if "states" in table.table:
        states = _list(table.at("states"), f"{table.where}.states", MAX_SIZE)
    if any(type(j) is not int for j in states):
        raise FormatError(f"{table.where}.states must be whole numbers, 1 the first state")
    A, E, C = baseline_loop(subject, output, K, tuple(j - 1 for j in states))
    sizes = placement.simplices(
        Claim("lyapunov", subject.A, subject.B, (), subject.law, (), subject.on)
    )
    evidence = []
    for key, letter in (("stability", "X"), ("covariance", "P")):
        below = table.below(key)
        below.only({letter, "degree", "elevation"})
        evidence.append(read_evidence(below.table, below.where, letter, len(A[0]), sizes))
    baseline = Baseline(A, E, C, evidence[0], evidence[1])
    level, intensity = entry.number("level"), entry.number("intensity", 1)
    return RelativeRms(subject, output, level, baseline, intensity)


_READERS: dict[str, Callable[[Subject, Output, _Entry], PerformanceClaim]] = {
    "rms": _rms,
    "energy peak": _energy,
    "initial peak": _initial,
    "gain": _gain,
    "relative rms": _relative,
}
