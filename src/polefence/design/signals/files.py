"""Performance files: a design and what is proved of its signals, written, and checked afresh."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.base.errors import DesignFileError, InputError, NotProvedError
from polefence.base.files import read_text, write_documents
from polefence.design.certificate import Certificate, Check, check_claim, plant_from
from polefence.design.design import FILE_NAME as DESIGN_NAME
from polefence.design.design import says_format
from polefence.design.signals.specification import rows
from polefence.design.statement import ellipsoid_text, impulses_text, output_text, points_text
from polefence.plant.family import UncertainPlant
from polefence.plant.names import quoted
from polefence.plant.outputs import Output
from polefence.proof import placement, reading, work
from polefence.proof.matrices import Rationals
from polefence.proof.performance import (
    FORMAT,
    LAW,
    EnergyPeak,
    Gain,
    GainNorm,
    InitialPeak,
    PerformanceClaim,
    RelativeRms,
    Rms,
    baseline_loop,
    prove_performance,
    read_performance,
)
from polefence.proof.placement import Evidence
from polefence.region.text import digits_down, digits_up

FILE_NAME = "performance.json"


def save(
    certificate: Certificate, claims: Sequence[PerformanceClaim], directory: str | Path
) -> Path:
    """Write ``performance.json``, and ``design.json`` beside it, into a folder; return the first.

    The folder is made if need be. The numbers are those that were proved: a double as it is, any
    other rational as "p/q".

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    documents = {
        FILE_NAME: performance_text(certificate, claims),
        DESIGN_NAME: certificate.dumps(),
    }
    return write_documents(Path(directory), documents)[0]


def performance_text(certificate: Certificate, claims: Sequence[PerformanceClaim]) -> str:
    """Return the text of a performance file: claims about the loop of a design's certificate."""
    document = {
        "format": FORMAT,
        "version": placement.VERSION,
        "design": certificate.document(),
        "specifications": [claim_document(claim) for claim in claims],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def claim_document(claim: PerformanceClaim) -> dict[str, Any]:
    """Return a claim as plain data; the plant and the law are the design's."""
    if isinstance(claim, GainNorm):
        return _gain_norm(claim)
    table: dict[str, Any] = {"kind": kind_of(claim), "name": claim.output.name}
    table["output"] = {"C": _rows(claim.output.C), "D": _rows(claim.output.D)}
    if isinstance(claim, Gain) and claim.F:
        table["output"]["F"] = _rows(list(claim.F))
    table["level"] = plain(claim.level)
    if isinstance(claim, Rms | RelativeRms):
        table["intensity"] = plain(claim.intensity)
    if isinstance(claim, EnergyPeak):
        table["norm"] = plain(claim.norm)
    if isinstance(claim, InitialPeak):
        if claim.points:
            table["points"] = [list(map(plain, point)) for point in claim.points]
        if claim.impulses:
            table["impulses"] = list(map(plain, claim.impulses))
        if claim.ellipsoid:
            table["ellipsoid"] = [list(map(plain, row)) for row in claim.ellipsoid]
    if isinstance(claim, RelativeRms):
        if not _without_control(claim):
            raise InputError(f"{claim.output.name}: only no control is written as a baseline")
        proofs = claim.baseline.stability, claim.baseline.covariance
        pairs = zip(("stability", "covariance"), "XP", proofs, strict=True)
        table["baseline"] = {key: _evidence(own, letter) for key, letter, own in pairs}
    table["evidence"] = _evidence(claim.subject.evidence)
    if claim.subject.law.K is not None:
        table["evidence"]["on"] = claim.subject.on
    return table


def _gain_norm(claim: GainNorm) -> dict[str, Any]:
    evidence: dict[str, Any] = {"elevation": claim.subject.evidence.elevation}
    if claim.subject.law.K is not None:
        evidence["on"] = claim.subject.on
    table: dict[str, Any] = {"kind": kind_of(claim), "name": LAW, "level": plain(claim.level)}
    table |= {key: list(map(plain, getattr(claim, key))) for key in ("rows", "columns")}
    return table | {"evidence": evidence}


def kind_of(claim: PerformanceClaim) -> str:
    """Return the kind of a claim as a file has it."""
    names: dict[type, str] = {
        Rms: "rms",
        EnergyPeak: "energy peak",
        InitialPeak: "initial peak",
        Gain: "gain",
        GainNorm: "gain norm",
    }
    return names.get(type(claim), "relative rms")


def plain(value: Fraction) -> float | int | str:
    """Return a number where a double holds it, else the string "p/q"."""
    if value.denominator == 1 and abs(value.numerator) < 2**53:
        return value.numerator
    try:
        return float(value) if Fraction(float(value)) == value else str(value)
    except OverflowError:
        return str(value)


def _matrix(matrix: Rationals) -> list[list[Any]]:
    return [list(map(plain, row)) for row in matrix]


def _rows(matrices: list[Rationals]) -> list[list[Any]]:
    """Return one row for all vertices where it is the same, else one a vertex."""
    rows = [_matrix(matrix)[0] for matrix in matrices]
    return rows[:1] if all(row == rows[0] for row in rows) else rows


def _evidence(evidence: Evidence, letter: str = "X") -> dict[str, Any]:
    if not evidence.X:  # the law's own W
        table: dict[str, Any] = {"own": True}
        if evidence.multiple:
            table["scale"] = plain(evidence.multiple[0])
    else:
        table = {letter: list(map(_matrix, evidence.X)), "degree": evidence.degree}
        if evidence.multiple:
            table["multiple"] = list(map(plain, evidence.multiple))
    return table | {"elevation": evidence.elevation}


def is_performance_file(path: Path) -> bool:
    """Whether a file, or the one of that name in a folder, says that it is of this format."""
    if path.is_dir():
        return (path / FILE_NAME).is_file()
    return says_format(path, FORMAT)


def check_performance(path: str | Path) -> Check:
    """Prove a performance file afresh in exact arithmetic: its region and every bound.

    Of a folder the ``design.json`` in it must be the design that the bounds are about. An output
    that has the name of one of the plant's signals must be that signal.

    Returns
    -------
    Check
        "proved" if everything is, "refuted" with an alpha whose poles leave the region, else
        "undecided".

    Raises
    ------
    DesignFileError
        If the file cannot be read as a performance file.
    """
    where, claims, document = _read(path)
    beside = where.parent / DESIGN_NAME
    if Path(path).is_dir() and beside.exists() and not _same(beside, document["design"]):
        return Check("undecided", f"{DESIGN_NAME} in the folder is not the design of {FILE_NAME}")
    try:
        plant = plant_from(document["design"]["plant"])
        for claim in claims:
            if not _is_named_so(plant, claim):
                name = claim.output.name
                reason = f"the output called {quoted(name)} is another of the plant's"
                return Check("undecided", reason, claims=(statement(claim, plant),))
        design, _ = placement.read(json.dumps(document["design"]))
        with work.counted():  # one count for the file, however many its claims
            return _prove_all(design, claims, plant)
    except (work.FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error


def _prove_all(
    design: placement.Claim, claims: Sequence[PerformanceClaim], plant: UncertainPlant
) -> Check:
    answer = check_claim(design)
    if not answer.proved:
        return replace(answer, reason=f"the design: {answer.reason}")
    said, count = list(answer.claims), int(answer.reason.split()[0])
    for claim in claims:
        verdict, own = prove_performance(claim), statement(claim, plant)
        if not verdict.proved:
            return Check("undecided", verdict.reason, claims=(own,))
        said.append(own)
        count += int(verdict.reason.split()[0])
    reason = f"{count} inequalities positive definite in exact arithmetic"
    return Check("proved", reason, claims=tuple(said))


def statements(path: str | Path) -> tuple[str, ...]:
    """Return what a performance file claims of signals, a line each; proved afresh.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    NotProvedError
        If it is not proved.
    """
    answer = check_performance(path)
    if not answer.proved:
        raise NotProvedError(f"{path}: {answer}")
    return answer.claims[1:]  # the first is of the poles


def _known(plant: UncertainPlant) -> dict[str, Output]:
    """Return the plant's signals whose names are no others' too."""
    names = [signal.name for signal in plant.signals]
    return {signal.name: signal for signal in plant.signals if names.count(signal.name) == 1}


def _is_named_so(plant: UncertainPlant, claim: PerformanceClaim) -> bool:
    """Whether an output is the signal of its name, where the plant has one."""
    signal = _known(plant).get(claim.output.name)
    if signal is None or isinstance(claim, GainNorm):
        return True
    return rows(plant, signal) == (claim.output.C, claim.output.D) and not getattr(claim, "F", ())


def _without_control(claim: RelativeRms) -> bool:
    """Whether the baseline is the same plant under no control."""
    base, states_ = claim.baseline, tuple(range(len(claim.subject.A[0])))
    return baseline_loop(claim.subject, claim.output, None, states_) == (base.A, base.E, base.C)


def statement(claim: PerformanceClaim, plant: UncertainPlant) -> str:
    """Say in a line what is claimed, rounded so that it is true as printed.

    The output is written out, for its name is the file's own; one that is none of the plant's
    signals is said to be defined by the file.
    """
    level = digits_up(claim.level)
    if isinstance(claim, GainNorm):
        return f"{kind_of(claim)} of {LAW} <= {level}{_units_of(claim)}"
    own, subject = claim.output, claim.subject
    name = quoted(own.name) if own.name else "an output"
    if own.name not in _known(plant):
        name = f"{name} (as the file defines it)"
    what = output_text(own.C, own.D, getattr(claim, "F", ()))
    return f"{kind_of(claim)} of {name} = {what} <= {level}{_under(claim)}, on the {subject.on}"


def _under(claim: PerformanceClaim) -> str:
    """Say what moves the signal."""
    if isinstance(claim, RelativeRms):
        other = "no control" if _without_control(claim) else "a loop that the file defines"
        return f" of that of {other}, at density {digits_down(2 * claim.intensity, 4)}"
    if isinstance(claim, Rms):
        return f" at density {digits_down(2 * claim.intensity, 4)}"
    if isinstance(claim, EnergyPeak):
        return f" at norm {digits_down(claim.norm, 4)}"
    if isinstance(claim, InitialPeak):
        starts = [points_text(claim.points)] * bool(claim.points)
        starts += [impulses_text(claim.impulses)] * any(claim.impulses)
        starts += [ellipsoid_text(claim.ellipsoid)] * bool(claim.ellipsoid)
        return f" from {', or from '.join(starts)}"
    return ""


def _units_of(claim: GainNorm) -> str:
    """Say what one unit of each state and input is, where it is not one of the plant's."""
    said = [
        f"{name} in units of {', '.join(digits(unit, 4) for unit in units)}"
        for name, units, digits in (
            ("states", claim.columns, digits_down),
            ("inputs", claim.rows, digits_up),
        )
        if any(unit != 1 for unit in units)
    ]
    return f", {' and '.join(said)}" if said else ""


def performance_plant(path: str | Path) -> UncertainPlant:
    """Return the plant of a performance file; proves nothing.

    Raises
    ------
    DesignFileError
        If the file cannot be read as a performance file.
    """
    where, _, document = _read(path)
    try:
        return plant_from(document["design"]["plant"])
    except DesignFileError as error:
        raise DesignFileError(f"{where}: {error}") from error


def _read(path: str | Path) -> tuple[Path, list[PerformanceClaim], dict[str, Any]]:
    where = _where(Path(path))
    text = read_text(where, reading.MAX_BYTES, DesignFileError)
    try:
        return where, *read_performance(text)
    except work.FormatError as error:
        raise DesignFileError(f"{where}: {error}") from error


def _same(path: Path, design: Any) -> bool:
    """Whether a design file holds this design, number for number."""
    try:
        return bool(reading.parse(read_text(path, reading.MAX_BYTES, DesignFileError)) == design)
    except work.FormatError as error:
        raise DesignFileError(f"{path}: no design file: {error}") from error


def _where(path: Path) -> Path:
    return path / FILE_NAME if path.is_dir() else path
