"""Statement of what is guaranteed of exported code: lines for its head, and its page.

Every sentence is made of what a file about the code holds: claims that are proved, or what was
sampled and is said to be. So `polefence check` writes the lines again, and compares.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from polefence.design.certificate import Certificate
from polefence.design.design import Design
from polefence.design.observer import Observer
from polefence.export.c99.program import Program, Scheduled
from polefence.export.c99.sources import Texts, context, environment
from polefence.export.timing import Timing, milliseconds
from polefence.proof.claims.rounding import Rounded, rounding_error
from polefence.proof.text import milliseconds_text
from polefence.region.regions import Region
from polefence.region.text import digits_down, digits_up, short_text

WIDTH, NO_BREAK = 88, "\u00a0"
MOST = 1e29  # a decay without bound [1/s]
README = "README.md"


@dataclass(frozen=True)
class Seen:
    """Findings about the sampled loop at sampled parameters, and by trial: no proof.

    Attributes
    ----------
    points : int
        Parameter values.
    inside : bool
        Whether the poles lay in the region, as log(z) / Ts.
    decay : float
        The slowest [1/s].
    region, stable : float
        The longest sample times that left the poles there, and the loop stable [s].
    observer : (int, float) or None
        Parameter values and slowest decay of the loop that the observer closes.
    """

    points: int
    inside: bool
    decay: float
    region: float
    stable: float
    observer: tuple[int, float] | None = None


@dataclass(frozen=True)
class Loop:
    """The loop as a computer closes it: its decay rate, where one is proved, and what was seen."""

    sample_time: float
    delay: int
    decay: Fraction | None
    seen: Seen
    reason: str = ""


@dataclass(frozen=True)
class Facts:
    """Facts that the lines are made of.

    Attributes
    ----------
    region : Region
    rounded : Rounded, optional
        What is proved of the code's rounding; None where nothing is, for the reason.
    sample_time : Fraction, optional
        The plant's own, in discrete time.
    limited : bool
        Whether the code cuts the inputs.
    """

    region: Region
    rounded: Rounded | None
    sample_time: Fraction | None
    limited: bool
    loop: Loop | None = None
    observer: Observer | None = None
    reason: str = ""


def loop_of(timed: Timing) -> Loop:
    """Return what was proved and found of the sampled loop."""
    own, beside = timed.sampling, timed.with_observer
    seen = Seen(
        own.points,
        own.inside,
        own.decay,
        timed.largest.region,
        timed.largest.stable,
        None if beside is None else (beside.points, min(beside.decay, MOST)),
    )
    proof = timed.proof
    decay = None if proof.claim is None else proof.claim.decay
    return Loop(own.sample_time, own.delay, decay, seen, proof.reason)


def statement(facts: Facts) -> tuple[str, ...]:
    """Return what is guaranteed, proved or sampled, and what is not."""
    sentences = [_rounding(facts), *_timing(facts)]
    own = facts.sample_time
    if own is not None:
        sentences.append(
            f"Run every {milliseconds_text(own)} ms, the plant's own, u without delay."
        )
    if facts.observer is not None:
        sentences += _observer(facts, facts.observer)
    sentences.append(_outside(facts))
    region = short_text(facts.region)
    return tuple(line for each in sentences for line in _wrapped(each, region))


def _wrapped(sentence: str, region: str) -> list[str]:
    """Break a sentence into lines, but not the region."""
    whole = sentence.replace(region, region.replace(" ", NO_BREAK))
    return [line.replace(NO_BREAK, " ") for line in textwrap.wrap(whole, WIDTH)]


def _rounding(facts: Facts) -> str:
    region = short_text(facts.region)
    if facts.rounded is None:
        return f"NOT PROVED to keep the poles in {region}: {facts.reason}."
    share = rounding_error(facts.rounded) / facts.rounded.gain.error
    return (
        f"Proved in exact arithmetic: all poles of A + B K lie in {region}, whatever the "
        "parameters, with the gain as this code computes it; its rounding is at most "
        f"{digits_up(100 * share, 2)} % of what is proved to leave them there."
    )


def _timing(facts: Facts) -> Iterator[str]:
    loop = facts.loop
    if loop is None:
        return
    seen, region = loop.seen, short_text(facts.region)
    late = ", u one step late" if loop.delay else ""
    time = f"Run every {milliseconds_text(Fraction(loop.sample_time))} ms{late}"
    if loop.decay is not None:
        rate = digits_down(loop.decay, 3)
        yield f"{time}: with x measured the loop is proved to decay, at {rate} 1/s or faster."
    else:
        yield f"{time}: NOT PROVED to be stable: {loop.reason}."
    where, slowest = "in" if seen.inside else "NOT all in", digits_down(seen.decay, 3)
    yield (
        f"Sampled, not proved: at {seen.points} parameter values its poles, as log(z) / Ts, were "
        f"{where} {region}, the slowest decay {slowest} 1/s."
    )
    held, stable = (milliseconds(t) for t in (seen.region, seen.stable))
    yield f"By trial, not proved: the region holds up to {held}, stability up to {stable}."


def _observer(facts: Facts, observer: Observer) -> Iterator[str]:
    proved = "proved" if observer.design.proved else "NOT PROVED"
    time = "" if facts.sample_time is not None else "in continuous time and "
    yield (
        f"Observer: {proved} that the poles of its error lie in {short_text(observer.region)}, "
        f"{time}without rounding."
    )
    if facts.loop is not None and facts.loop.seen.observer is not None:
        points, decay = facts.loop.seen.observer
        how = f"decay {digits_down(decay, 3)} 1/s or faster" if decay > 0 else "are NOT stable"
        yield f"With it, sampled, not proved: the loops of {points} parameter values {how}."


def _outside(facts: Facts) -> str:
    sampled = facts.loop is not None or facts.sample_time is not None
    missing = ["underflow"] if sampled else ["sampling", "delay", "underflow"]
    without = ", ".join(missing) + (" or limits" if facts.limited else "")
    return f"At constant parameters, without {without}."


def own_readme(
    made: Program,
    texts: Texts,
    design: Design | Certificate,
    observed: bool,
    proved: bool = True,
) -> str:
    """Return the page's text."""
    facts = {
        "proved": proved,
        "discrete": design.plant.sample_time is not None,
        "bytes": local_bytes(made),
        "observer": observed,
    }
    template = environment().get_template("README.md.j2")
    return template.render(context(made, texts) | facts)


def local_bytes(made: Program) -> int:
    """Return the bytes of the arrays that an update keeps on the stack."""
    n, m = made.shape
    if not isinstance(made, Scheduled):
        return m * made.number.bits // 8
    own = len(made.shares) * 2 if made.shares else made.domain.corners
    count = own + sum(made.domain.sizes) + len(made.W) + (n + 1) * n + m
    return count * made.number.bits // 8
