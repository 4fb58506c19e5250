"""Read the table of a file about exported code that says how a loop decays as it is sampled."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import Rationals
from polefence.proof.placement import Claim, Evidence, read_evidence, simplices
from polefence.proof.reading import (
    MAX_SIZE,
    MAX_VERTICES,
    _at,
    _integer,
    _list,
    _only,
    read_matrix,
    read_number,
)
from polefence.proof.sampling.claims import Off, Sampled
from polefence.proof.sampling.error import MAX_TERMS
from polefence.proof.sampling.loop import domain
from polefence.proof.service.claims import Range
from polefence.proof.work import FormatError

_NUMBERS = ("sample_time", "decay", "radius", "error", "mu", "weight")
_BOUNDS = ("smallest", "energy")
_KEYS = {"delay", "T", "scale", "steps", "terms", "evidence", "elevation", "off"}


def read_sampling(table: Any, design: Claim, ranges: tuple[Range, ...]) -> Sampled:
    """Return what the table "sampling" claims of a design; proves nothing.

    Parameters
    ----------
    table : mapping
        Plain data of a JSON document.
    design : Claim
        Plant and law.
    ranges : tuple of Range
        The plant's parameters.

    Raises
    ------
    FormatError
        If something is missing, unknown, or its shapes do not fit.
    """
    whole = {"sampling": table}
    _at(whole, "sampling", "sample_time")
    _only(whole, "sampling", _KEYS | set(_NUMBERS) | set(_BOUNDS))
    n, m = len(design.A[0]), len(design.B[0][0])
    numbers = {key: _number(whole, key) for key in _NUMBERS}
    bounds = {key: _number(whole, key) for key in _BOUNDS if key in table}
    scale = _numbers(_at(whole, "sampling", "scale"), "sampling.scale")
    claim = Sampled(
        design=design,
        ranges=ranges,
        delay=_integer(table, "sampling", "delay", 1),
        T=read_matrix(_at(whole, "sampling", "T"), "sampling.T", n, n),
        scale=scale,
        steps=tuple(_steps(_at(whole, "sampling", "steps"), n, m)),
        terms=_terms(_at(whole, "sampling", "terms")),
        evidence=Evidence([]),
        elevation=_integer(table, "sampling", "elevation", 0),
        off=_off(table["off"], n) if "off" in table else None,
        **numbers,
        **bounds,
    )
    return replace(claim, evidence=_evidence(claim, _at(whole, "sampling", "evidence"), n, m))


def _evidence(claim: Sampled, table: Any, n: int, m: int) -> Evidence:
    where = "sampling.evidence"
    _only({where: table}, where, {"X", "degree", "elevation", "multiple"})
    sizes = simplices(replace(claim.design, on=domain(claim)))
    return read_evidence(table, where, "X", n + m if claim.delay else n, sizes)


def _off(table: Any, n: int) -> Off:
    where = "sampling.off"
    _only({where: table}, where, {"error", "rows", "columns"})
    error, rows, columns = (_at({where: table}, where, k) for k in ("error", "rows", "columns"))
    return Off(
        read_number(error, f"{where}.error"),
        _numbers(rows, f"{where}.rows"),
        read_matrix(columns, f"{where}.columns", n, n),
    )


def _steps(value: Any, n: int, m: int) -> list[Rationals]:
    steps = _list(value, "sampling.steps", MAX_VERTICES)
    return [read_matrix(step, "sampling.steps", n, n + m) for step in steps]


def _terms(value: Any) -> int:
    if type(value) is not int or not 1 <= value <= MAX_TERMS:
        raise FormatError(f"sampling.terms must be a whole number, 1 to {MAX_TERMS}")
    return value


def _number(whole: dict[str, Any], key: str) -> Fraction:
    return read_number(_at(whole, "sampling", key), f"sampling.{key}")


def _numbers(value: Any, where: str) -> tuple[Fraction, ...]:
    return tuple(read_number(v, where) for v in _list(value, where, MAX_SIZE))
