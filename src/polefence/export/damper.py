"""A law of controllable dampers as C99: coefficients from states, with the numbers of its proof."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, NotProvedError
from polefence.base.explained import explained
from polefence.export.damper_words import in_words, scales_of
from polefence.export.documents import FILE_NAME
from polefence.export.program import WORDS, Number, number
from polefence.export.sources import MARKER, check_c_name, environment
from polefence.plant.outputs import split
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import Clipped
from polefence.proof.claims.words import largest, two
from polefence.proof.dampers import SemiActive
from polefence.proof.document import Document
from polefence.proof.plant import Plant
from polefence.proof.text import digits_down, digits_up, number_text, visible


@explained
def damper_sources(
    document: Document,
    bits: int = 32,
    *,
    name: str = "law",
    fixed: int | None = None,
    ranges: Mapping[str, float] | None = None,
) -> Mapping[str, bytes]:
    """Return the files of a law that `polefence.semi_active` proved: header, code and proof.

    The code's coefficients never leave the dampers' bounds, whatever its rounding and its sample
    time: the loop is stable by the proof, which holds for every choice between them. The bound on
    the rms is that of the same numbers without rounding, at every instant.

    Parameters
    ----------
    document : Document
        The file of `SemiActiveLaw.file`, or as it was read.
    bits : int
        32 or 64. Bounds that are no numbers of this format are rounded inwards.
    name : str
        Begins the names of files and functions; a C identifier.
    fixed : int, optional
        16 or 32: the code computes in integers of so many bits, in place of floats.
    ranges : mapping, optional
        For ``fixed`` the largest absolute value of each signal, by its name, in its unit.

    Raises
    ------
    InputError
        If it has no such claim, or a number is none of the format; of fixed point if a range is
        missing, or a coefficient has no room between its bounds.
    NotProvedError
        If the claim is not proved.
    """
    check_c_name(name)
    claim = document.first(Clipped)
    if claim is None:
        raise InputError("no claim about a law of controllable dampers")
    verdict = prove(claim)
    if not verdict.proved:
        raise NotProvedError(f"not proved: {verdict.reason}")
    form, kind = environment(), "damper" if fixed is None else "fixed_damper"
    if fixed is None:
        if ranges:
            raise InputError("ranges of signals are for fixed-point code; give --fixed too")
        values = _context(document.plant, claim, number(bits), name)
    else:
        values = _of_words(document.plant, claim, fixed, ranges or {}, name)
    files = {f"{name}.{end}": f"{kind}.{end}.j2" for end in "hc"}
    made = {file: form.get_template(template).render(values) for file, template in files.items()}
    made[FILE_NAME] = document.dumps()
    return {file: text.encode() for file, text in made.items()}


def _context(plant: Plant, claim: Clipped, form: Number, name: str) -> dict[str, Any]:
    """Return the context of the templates."""
    dampers, n = list[dict[str, Any]](), _needed(claim)
    for row, damper in zip(claim.K, claim.dampers, strict=True):
        parts = damper.parts
        lines = [damper.lines(part) for part in parts]
        dampers.append(
            {
                "text": _text_of(plant, damper),
                "K": [_exactly(x, form) for x in row[:n]],
                "rate": [form.text(form.outward(x, up=True)) for x in damper.rate[0][0][:n]],
                "starts": [_text(start, form) for start, _ in parts],
                "low": [[_text(x, form, up=True) for x in low] for low, _ in lines],
                "high": [[_text(x, form) for x in high] for _, high in lines],
            }
        )
    return _common(plant, claim, name, dampers, ("starts", "low", "high")) | {
        "lows": [_text(damper.ends[0], form, up=True) for damper in claim.dampers],
        "highs": [_text(damper.ends[1], form) for damper in claim.dampers],
        "number": form,
        "prefix": form.largest[:3],
        "zero": form.text(0.0),
    }


def _text_of(plant: Plant, damper: SemiActive) -> str:
    """Say what a damper's coefficient is."""
    label = plant.inputs[damper.number] if plant.inputs else f"u{damper.number + 1}"
    lowest, highest = damper.ends
    return (
        f"of {label}: the force over the rate, {number_text(lowest)} to {number_text(highest)}"
        + ("" if damper.straight else ", as its curves allow at the rate")
    )


def _common(
    plant: Plant, claim: Clipped, name: str, dampers: list[dict[str, Any]], keys: Sequence[str]
) -> dict[str, Any]:
    """Return what floats and integers share; each damper gets as many parts, its last one again."""
    most = max(len(damper["low"]) for damper in dampers)
    for own in dampers:
        for key in keys:
            own[key] += own[key][-1:] * (most - len(own[key]))
    outputs = ", ".join(output.name for output in claim.limit.outputs)
    level = digits_up(claim.limit.level)
    statement = (
        f"Proved, see {FILE_NAME}: the rms of {outputs} is at most {level} for all values of "
        "the parameters where the force is so at every instant; and the loop is exponentially "
        "stable whatever coefficients between the bounds are set, and when.",
        *([] if plant.data is None else [visible(plant.data.note)]),
    )
    return {
        "marker": MARKER,
        "name": name,
        "NAME": name.upper(),
        "title": f"Coefficients of controllable dampers: {plant.name}",
        "statement": statement,
        "states": _names(plant)[: _needed(claim)],
        "dampers": dampers,
        "parts": most,
    }


def _names(plant: Plant) -> tuple[str, ...]:
    return plant.states or tuple(f"x{i + 1}" for i in range(plant.n))


def _of_words(
    plant: Plant, claim: Clipped, bits: int, ranges: Mapping[str, float], name: str
) -> dict[str, Any]:
    """Return the context of the templates in fixed point."""
    if bits not in WORDS:
        raise InputError(f"fixed = {bits!r} is not supported; use 16 or 32")
    n, top = _needed(claim), largest(bits)
    known = [split(state)[0] for state in _names(plant)[:n]]
    signals = scales_of(known, ranges, bits)
    pairs = list(zip(claim.K, claim.dampers, strict=True))
    made = [in_words(row[:n], damper, signals, bits) for row, damper in pairs]
    dampers = [
        asdict(words) | {"text": _text_of(plant, damper)}
        for words, (_, damper) in zip(made, pairs, strict=True)
    ]
    keys = ("starts", "low", "low_start", "high", "high_start")
    common = _common(plant, claim, name, dampers, keys)
    told = ", ".join(digits_up(words.error, 3) for words in made)
    rounded = (
        f"Rounding changes the force of a damper by at most {told} while the signals are in their "
        "ranges; no coefficient leaves its bounds, whatever is given."
    )
    return common | {
        "statement": (*common["statement"], rounded),
        "bits": bits,
        "wide": f"int{2 * bits}_t",
        "top": top,
        "of_states": signals,
        "reach": [digits_down(top * two(-s), 3) for s in signals],
    }


def _text(value: Fraction | None, form: Number, up: bool = False) -> str:
    """Return a number of a curve as text."""
    return form.text(form.outward(value or Fraction(0), up=up))


def _needed(claim: Clipped) -> int:
    """Return how many states the code takes: the last ones are left out if no force uses them.

    These are those of filters behind the signals.
    """
    rows = [*claim.K, *(damper.rate[0][0] for damper in claim.dampers)]
    return 1 + max(i for row in rows for i, x in enumerate(row) if x)


def _exactly(value: Fraction, form: Number) -> str:
    """Return an entry of K as text; `polefence.semi_active` makes it a 32-bit number."""
    rounded = form.outward(value, up=True)
    if Fraction(rounded) != value:
        raise InputError(f"K has {float(value)!r}, which is not a number of {form.bits} bits")
    return form.text(rounded)
