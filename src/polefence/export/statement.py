"""What is guaranteed of exported code, in lines for its head."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from fractions import Fraction

from polefence.design import Design
from polefence.export.guarantee import Guarantee
from polefence.export.timing import Timing, milliseconds
from polefence.observer import Observer
from polefence.proof.statement import milliseconds_text
from polefence.region_text import digits_down, digits_up, short_text

WIDTH, NO_BREAK = 88, "\u00a0"


def statement(
    design: Design, limited: bool, found: Guarantee, timed: Timing | None, observer: Observer | None
) -> list[str]:
    """Return what is guaranteed, proved or sampled, and what is not."""
    sentences = [_rounding(design, found), *_timing(design, timed)]
    own = design.plant.sample_time
    if own is not None:
        sentences.append(
            f"Run every {milliseconds_text(own)} ms, the plant's own, u without delay."
        )
    if observer is not None:
        sentences += _observer(observer, timed)
    sentences.append(_outside(limited, sampled=timed is not None or own is not None))
    return [line for each in sentences for line in _wrapped(each, short_text(design.region))]


def _wrapped(sentence: str, region: str) -> list[str]:
    """Break a sentence into lines, but not the region."""
    whole = sentence.replace(region, region.replace(" ", NO_BREAK))
    return [line.replace(NO_BREAK, " ") for line in textwrap.wrap(whole, WIDTH)]


def _rounding(design: Design, found: Guarantee) -> str:
    region = short_text(design.region)
    if not design.proved:
        return f"NOT PROVED to keep the poles in {region}: the design itself is not proved."
    if not found.proved:
        return f"NOT PROVED to keep the poles in {region}: {found.reason}."
    return (
        f"Proved in exact arithmetic: all poles of A + B K lie in {region}, whatever the "
        "parameters, with the gain as this code computes it; its rounding is at most "
        f"{digits_up(100 * found.share, 2)} % of what the design tolerates."
    )


def _timing(design: Design, timed: Timing | None) -> Iterator[str]:
    if timed is None:
        return
    seen = timed.sampling
    time = f"Run every {milliseconds_text(Fraction(seen.sample_time))} ms{timed.late}"
    if timed.proof.proved:
        rate = digits_down(timed.proof.decay, 3)
        yield f"{time}: with x measured the loop is proved to decay, at {rate} 1/s or faster."
    else:
        yield f"{time}: NOT PROVED to be stable: {timed.proof.reason}."
    where, slowest = "in" if seen.inside else "NOT all in", digits_down(seen.decay, 3)
    yield (
        f"At {seen.points} sampled parameter values its poles, as log(z) / Ts, were {where} "
        f"{short_text(design.region)}, the slowest decay {slowest} 1/s."
    )
    region, stable = (milliseconds(t) for t in (timed.largest.region, timed.largest.stable))
    yield f"By trial the region holds up to {region}, stability up to {stable}."


def _observer(observer: Observer, timed: Timing | None) -> Iterator[str]:
    proved = "proved" if observer.design.proved else "NOT PROVED"
    time = "" if observer.plant.sample_time is not None else "in continuous time and "
    yield (
        f"Observer: {proved} that the poles of its error lie in {short_text(observer.region)}, "
        f"{time}without rounding."
    )
    if timed is not None and timed.with_observer is not None:
        loop = timed.with_observer
        how = (
            f"decay {digits_down(loop.decay, 3)} 1/s or faster" if loop.stable else "are NOT stable"
        )
        yield f"With it, not proved: the loops of {loop.points} sampled parameter values {how}."


def _outside(limited: bool, sampled: bool) -> str:
    missing = ["underflow"] if sampled else ["sampling", "delay", "underflow"]
    without = ", ".join(missing) + (" or limits" if limited else "")
    return f"At constant parameters, without {without}."
