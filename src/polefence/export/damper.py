"""A law of controllable dampers as C99: coefficients from states, with the numbers of its proof."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, NotProvedError
from polefence.base.explained import explained
from polefence.export.documents import FILE_NAME
from polefence.export.program import Number, number
from polefence.export.sources import MARKER, check_c_name, environment
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import Clipped
from polefence.proof.document import Document
from polefence.proof.plant import Plant
from polefence.proof.text import digits_up, number_text


@explained
def damper_sources(document: Document, bits: int = 32, *, name: str = "law") -> Mapping[str, bytes]:
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

    Raises
    ------
    InputError
        If it has no such claim, or a number is none of the format.
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
    values, form = _context(document.plant, claim, number(bits), name), environment()
    files = {f"{name}.{end}": f"damper.{end}.j2" for end in "hc"}
    made = {file: form.get_template(template).render(values) for file, template in files.items()}
    made[FILE_NAME] = document.dumps()
    return {file: text.encode() for file, text in made.items()}


def _context(plant: Plant, claim: Clipped, form: Number, name: str) -> dict[str, Any]:
    """Return the context of the templates."""
    dampers, n = list[dict[str, Any]](), _needed(claim)
    for row, damper in zip(claim.K, claim.dampers, strict=True):
        label = plant.inputs[damper.number] if plant.inputs else f"u{damper.number + 1}"
        lowest, highest = damper.ends
        parts = damper.parts
        lines = [damper.lines(part) for part in parts]
        dampers.append(
            {
                "text": f"of {label}: the force over the rate, "
                f"{number_text(lowest)} to {number_text(highest)}"
                + ("" if damper.straight else ", as its curves allow at the rate"),
                "K": [_exactly(x, form) for x in row[:n]],
                "rate": [form.text(form.outward(x, up=True)) for x in damper.rate[0][0][:n]],
                "starts": [_text(start, form) for start, _ in parts],
                "low": [[_text(x, form, up=True) for x in low] for low, _ in lines],
                "high": [[_text(x, form) for x in high] for _, high in lines],
            }
        )
    most = max(len(damper["low"]) for damper in dampers)
    for own in dampers:  # as many parts for each, the last one again
        for key in ("starts", "low", "high"):
            own[key] += own[key][-1:] * (most - len(own[key]))
    outputs = ", ".join(output.name for output in claim.limit.outputs)
    level = digits_up(claim.limit.level)
    statement = (
        f"Proved, see {FILE_NAME}: the rms of {outputs} is at most {level} for all values of "
        "the parameters where the force is so at every instant; and the loop is exponentially "
        "stable whatever coefficients between the bounds are set, and when.",
    )
    return {
        "marker": MARKER,
        "name": name,
        "NAME": name.upper(),
        "title": f"Coefficients of controllable dampers: {plant.name}",
        "statement": statement,
        "states": (plant.states or tuple(f"x{i + 1}" for i in range(plant.n)))[:n],
        "dampers": dampers,
        "parts": most,
        "lows": [_text(damper.ends[0], form, up=True) for damper in claim.dampers],
        "highs": [_text(damper.ends[1], form) for damper in claim.dampers],
        "number": form,
        "prefix": form.largest[:3],
        "zero": form.text(0.0),
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
