"""``polefence semi-active``: a law for controllable dampers, and a lower bound for every logic."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from polefence.base.errors import InputError, NotProvedError
from polefence.base.files import write_documents
from polefence.certify.refutation import FILE_NAME as LIMIT
from polefence.certify.refutation import Refutation, lowest
from polefence.cli.lines import matrix_text
from polefence.cli.optimise import asked
from polefence.cli.options import (
    minimise_argument,
    result_arguments,
    road_arguments,
    road_of,
    spec_argument,
    structure_of,
)
from polefence.cli.output import NOT_PROVED, PROVED, check_results, saved, write_json
from polefence.cli.subjects import Subject, read_spec
from polefence.cli.terminal import say
from polefence.law.structure import Structure
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.weights import measurable
from polefence.region.text import digits_down, digits_up
from polefence.requirements.rms import Rms
from polefence.search.rows import plant_summary
from polefence.search.semi_active import (
    DEGREES,
    DamperQuestion,
    SemiActiveLaw,
    Unproved,
)
from polefence.search.semi_active import (
    FILE_NAME as LAW,
)

Lowest = tuple[Refutation, float] | None  # that no law goes below a level


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `semi-active`."""
    add_question(parser)
    parser.add_argument(
        "--degree",
        type=int,
        metavar="N",
        help="2, 4, 6 or 8, of the polynomial that proves the bound; default: the highest up to "
        f"{max(DEGREES)} that is quick",
    )
    parser.add_argument(
        "--measured",
        metavar="NAMES",
        help="'A, B': states, or sums of states, of which the law is made, and of the rates of the "
        "dampers; default: the spec's law.measured, else all states",
    )
    result_arguments(parser, f"write the proofs, {LAW} and {LIMIT}")


def add_question(parser: argparse.ArgumentParser) -> None:
    """Declare what is minimised of controllable dampers, and on which road."""
    spec_argument(parser)
    minimise_argument(parser, "'rms of [NAME, NAME]'")
    parser.set_defaults(limit=[])  # a damper's bounds are its only limits
    road_arguments(parser)


def question_of(options: Any) -> tuple[Subject, Rms]:
    """Read a spec with controllable dampers, and the rms that is minimised.

    Raises
    ------
    InputError
        Naming what a law of dampers cannot be designed for.
    """
    subject = read_spec(options.spec)
    plant = subject.plant
    if not subject.dampers:
        raise InputError(
            f'{options.spec}: has no controllable damper; write [damper."FORCE"] with deflection '
            "and range"
        )
    if len(measurable(plant)) < plant.shape[0]:
        raise InputError(
            f"{options.spec}: laws of controllable dampers use all states, but those of "
            "road.tracks, weights and dead times cannot be measured; name independent roads by "
            "under, and leave the others out"
        )
    for damper in subject.dampers:
        try:
            damper.of(plant)
        except InputError as error:
            where = f"{options.spec}: damper.{damper.force!r}: "
            raise InputError(where + str(error).removeprefix(f"damper {damper.force}: ")) from error
    least, _ = asked(plant, options, road_of(options))
    if not isinstance(least, Rms) or not least.limits_rms:
        raise InputError(
            f"{options.spec}: {least.title} is minimised; for "
            "controllable dampers minimise an rms: "
            "--minimise 'rms of SIGNAL'"
        )
    return subject, least


def measured_of(plant: UncertainPlant, options: Any) -> tuple[str, ...] | None:
    """Return what the spec or the option says that the law measures.

    Raises
    ------
    InputError
        If the spec asks for a law that dampers cannot have.
    """
    given = argparse.Namespace(spec=options.spec, measured=options.measured)
    structure = structure_of(plant, given)
    if structure is None:
        return None
    free = replace(structure, measured=None, schedule=None, degree=1)
    if free != Structure():
        raise InputError(
            f"{options.spec}: law: of controllable dampers it is one gain of what is measured; "
            "leave out all but measured"
        )
    return structure.measured


@dataclass(frozen=True)
class Answer:
    """What was found: the law, or why no bound was proved, and what others have."""

    plant: UncertainPlant
    specification: Rms
    others: Unproved
    law: SemiActiveLaw | None
    reason: str
    below: Mapping[str, Lowest]
    measured: tuple[str, ...] | None = None


def semi_active_command(options: Any) -> int:
    """Design a law for controllable dampers; prove its rms, and a lower bound for every logic."""
    subject, least = question_of(options)
    plant, dampers = subject.plant, subject.dampers
    measured = measured_of(plant, options)
    check_results(options, LAW, LIMIT)
    question, law, reason = DamperQuestion.of(plant, least, dampers, measured), None, ""
    others = question.unproved
    try:
        law = question.law(options.degree)
    except NotProvedError as error:
        reason = str(error)
    logics = (("semi-active law", others.dampers), ("law", ()))
    below = {name: lowest(plant, least, others.passive, logic) for name, logic in logics}
    answer = Answer(plant, least, others, law, reason, below, measured)
    if options.output is not None:
        proof = below["semi-active law"]
        files = {} if law is None else {LAW: law.file().dumps()}
        files |= {} if proof is None else {LIMIT: proof[0].file().dumps()}
        saved(*write_documents(options.output, files))
    if options.json is not None:
        write_json(options.json, _document(answer))
    say(*_lines(answer))
    if law is None and options.output is not None and (options.output / LAW).exists():
        say(f"note: {options.output / LAW} is that of an earlier design")
    return NOT_PROVED if law is None else PROVED


def _lines(answer: Answer) -> list[str]:
    """Return what to print."""
    law, others = answer.law, answer.others
    stays = zip(others.dampers, others.coefficients, strict=True)
    fixed = ", ".join(f"{_staying(damper, c)} for {damper.force}" for damper, c in stays)
    if law is None:
        lines = [f"not proved: {answer.reason}"]
    else:
        lines = [
            f"proved: {law.specification.title} <= {digits_up(law.level)} for every alpha, by a "
            f"polynomial of degree {law.degree}",
            f"  u = K x, clipped to what the dampers give; K = {matrix_text(law.K)}",
        ]
        if answer.measured is not None:
            lines.append(f"  of {', '.join(answer.measured)} and the rates of the dampers alone")
    lines.append(f"  with the best fixed dampers, {fixed}: {others.passive:.6g}")
    for name, limit in answer.below.items():
        if limit is not None:
            proof, level = limit
            lines.append(f"  proved: no {name} goes below {digits_down(level)} at {proof.where}")
    return lines


def _staying(damper: Damper, c: float) -> str:
    """Say which damper it is that stays: of bent curves a mean of both."""
    low, high = damper.curves
    if not (low.bends or high.bends):
        return f"{c:g} N s/m"
    least, most = float(low.ratios[0]), float(high.ratios[1])
    return f"{(c - least) / (most - least):.1%} of the way from low to high"


def _document(answer: Answer) -> dict[str, Any]:
    """Return the summary."""
    law, others = answer.law, answer.others
    proved: dict[str, Any] = {"answer": "undecided", "reason": answer.reason}
    if law is not None:
        proved = {
            "answer": "proved",
            "at_most": law.level,
            "degree": law.degree,
            "K": law.K.tolist(),
            "measured": None if answer.measured is None else list(answer.measured),
        }
    return {
        "plant": plant_summary(answer.plant),
        "specification": answer.specification.title,
        **proved,
        "dampers": [
            {
                "force": damper.force,
                "deflection": damper.deflection,
                **damper.summary,
                "best that stays": c,
            }
            for damper, c in zip(others.dampers, others.coefficients, strict=True)
        ],
        "best that stay": others.passive,
        **{
            f"no {name} below": None if limit is None else limit[1]
            for name, limit in answer.below.items()
        },
    }
