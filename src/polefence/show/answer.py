"""What a report says first: the answer in three sentences, promises in a table, one picture."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.readable import compared, people, sample_text, scaled_text
from polefence.certify.bounds import sampled
from polefence.certify.checks import implies_stability
from polefence.certify.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.signal import SignalClaim
from polefence.proof.text import quoted
from polefence.region.text import digits_down, digits_up, short_text
from polefence.requirements import gain as gains
from polefence.requirements import rms
from polefence.requirements.specification import Specification
from polefence.response.closed import close
from polefence.response.stationary import unstable
from polefence.show.plots import new_figure, typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIGITS = 4  # of numbers that people read; files and later sections have six
MOST_BARS = 8
PROVED, SAMPLED, WITHOUT = "#b2182b", "#2166ac", "0.75"


@dataclass(frozen=True, eq=False)
class Promise:
    """What a claim bounds, beside what samples show with the law and without it.

    Attributes
    ----------
    what, under : str
        What is bounded, and under which motion, in words.
    text : str
        What is proved of it, as the claim says it.
    level : Fraction, optional
        What it is proved not to exceed, in its unit; None of claims that say something else.
    unit : str
    sampled, without : float, optional
        The worst sample, with the law and without control; None where it is not sampled, infinite
        where the plant itself is not stable.
    """

    what: str
    under: str
    text: str
    level: Fraction | None = None
    unit: str = ""
    sampled: float | None = None
    without: float | None = None

    @property
    def texts(self) -> tuple[str, str, str]:
        """What is proved with its unit, and the worst samples, in the unit that people use."""
        if self.level is None:
            return self.text, "", ""
        unit, times = people(float(self.level), self.unit)
        most = f"at most {scaled_text(digits_up(self.level, DIGITS), times)} {unit}".strip()
        own = "" if self.sampled is None else sample_text(self.sampled, times)
        if self.without is None:
            return most, own, ""
        if self.without == np.inf:
            return most, own, "unstable"
        return most, own, sample_text(self.without, times)

    @property
    def beside(self) -> str:
        """What is proved, as a share of the worst without control."""
        if not self.without or self.without == np.inf or self.level is None:
            return ""
        return compared(float(self.level), self.without)


def promise(
    design: Design, claim: SignalClaim, words: tuple[str, str, str], alpha: Array
) -> Promise:
    """Return a claim's promise, with samples at points alpha where its kind has them.

    Parameters
    ----------
    words : tuple of str
        What is bounded, its unit, and under which motion, but for the disturbances.
    """
    what, unit, under = words
    under = f"{under}{_acting(claim, design.plant)}{claim.time_text}".removeprefix(", ")
    text = f"{claim.worst_text} {unit}".strip()
    if claim.worst_text != f"at most {digits_up(claim.level)}":
        return Promise(what, under, text)
    own, asked = Promise(what, under, text, claim.level, unit), _asked(claim, design.plant)
    worst = None if asked is None else _worst(design, design, asked, alpha)
    if asked is None or worst is None or worst > claim.level:  # it is of something else
        return own
    without = _worst(design, None, asked, alpha)
    if without is None and not _is_stable(design.plant, alpha):
        without = np.inf
    return replace(own, sampled=worst, without=without)


def _asked(claim: SignalClaim, plant: UncertainPlant) -> Specification | None:
    """Return the requirement that a claim is of; None of other kinds than rms and gain."""
    names = tuple(output.name for output in claim.outputs)
    if not {signal.name for signal in plant.signals}.issuperset(names):
        return None
    own: dict[str, Any] = {"disturbances": None}
    if claim.scales:
        acting = [(_name(plant, k), float(claim.scales[k])) for k in claim.acting]
        own["disturbances"] = dict(acting)
    try:
        if type(claim) is Rms:
            own |= rms.filtered_by([None if one is None else one.name for one in claim.filters])
            return rms.Rms(names, density=2 * float(claim.intensity), **own)
        if type(claim) is Gain and not claim.filters:
            band = None if claim.band is None else (claim.band.low, claim.band.high)
            return gains.Gain(names, band=band, **own)
    except InputError:
        return None
    return None


def _acting(claim: SignalClaim, plant: UncertainPlant) -> str:
    """Say which disturbances act: the usual ones in a few words, others by their names."""
    if not claim.scales:
        return ""
    # noise of sensors acts with its own density on an rms, and on nothing else
    noise = float(2 * claim.intensity) ** -0.5 if isinstance(claim, Rms) else 0.0
    usual = [1.0 if physical else noise for physical in plant.physical]
    if np.allclose([float(scale) for scale in claim.scales], usual, rtol=1e-5):
        return " with the noise of the sensors" * bool(noise)
    acting = [(quoted(_name(plant, k)), claim.scales[k]) for k in claim.acting]
    each = [n if t == 1 else f"{n} times {digits_down(t, DIGITS)}" for n, t in acting]
    return f" from {' and '.join(each)} alone"


def _name(plant: UncertainPlant, k: int) -> str:
    return disturbances(plant)[k].name


def _worst(design: Design, law: Any, asked: Specification, alpha: Array) -> float | None:
    """Return the worst sample; None where the loop is not stable, or has no such value."""
    try:
        worst = float(sampled(design.plant, law, asked, alpha).worst)
    except InputError:
        return None
    return worst if np.isfinite(worst) else None


def _is_stable(plant: UncertainPlant, alpha: Array) -> bool:
    return not unstable(close(plant, None, alpha, disturbed=False).closed, float(plant.step)).size


def sentences(design: Design, promises: Sequence[Promise]) -> tuple[str, ...]:
    """Return the answer in three sentences: the loop, the first promise, and what is proved."""
    stable = ", so that the loop is stable" * implies_stability(design.plant, design.region)
    family = " and ".join(map(_range, design.plant.parameters))
    count = len(design.plant.vertices)
    whole = f"every {family}" if family else f"every mixture of the {count} vertices"
    whole = whole if family or count > 1 else "this plant"
    every = f"For {whole} all closed-loop poles are in {short_text(design.region)}{stable}."
    last = (
        f"This is proved in exact arithmetic{', not for samples alone' * (count > 1)}; "
        "polefence check design.json proves it again."
    )
    return (every, *map(_first, promises[:1]), last)


def _range(parameter: Parameter) -> str:
    # a label is the file's text: one that is more than a few words could pass for a claim
    known = re.fullmatch(r"[^\W\d_][\w -]{0,29}", parameter.label)
    name = f"{parameter.name} ({parameter.label})" if known else parameter.name
    unit = parameter.unit if len(parameter.unit) <= 12 else ""
    ends = f"{digits_up(parameter.low)} to {digits_down(parameter.high)}"
    return f"{name} from {ends} {unit}".strip()


def _first(own: Promise) -> str:
    proved, _, without = own.texts
    text = " ".join(filter(None, (f"{own.what[:1].upper()}{own.what[1:]} is", proved, own.under)))
    if own.without == np.inf:
        return f"{text}; without control the plant is not stable."
    if not own.beside or own.level is None:
        return f"{text}."
    than = {"less": "than", "more": "than", "same": "as", "times": "that"}[own.beside.split()[-1]]
    unit = people(float(own.level), own.unit)[0]
    return f"{text}: {own.beside} {than} without control, {without} {unit}".rstrip() + "."


def shared(promises: Sequence[Promise]) -> str:
    """Return the motion that all promises are about; empty where they are about several."""
    under = {own.under for own in promises}
    return under.pop() if len(under) == 1 and len(promises) > 1 else ""


def rows(promises: Sequence[Promise]) -> tuple[tuple[str, ...], ...]:
    """Return the rows of a table of promises, without columns that are empty."""
    alone = not shared(promises)
    every = [(plainly(own.what), *own.texts, own.beside, own.under * alone) for own in promises]
    head = ("", "proved", "worst sample", "without control", "proved beside that", "when")
    kept = [k for k in range(len(head)) if any(row[k] for row in every)]
    return tuple(tuple(row[k] for k in kept) for row in (head, *every))


def picture(promises: Sequence[Promise]) -> Figure | None:
    """Draw what is proved and sampled beside no control; None where that has no samples."""
    some = [own for own in promises if own.level and own.beside and own.sampled][:MOST_BARS]
    if not some:
        return None
    figure, (ax,) = new_figure(1, 7.6, 0.7 + 0.62 * len(some))
    y = np.arange(len(some))[::-1]
    without = np.array([own.without or 1.0 for own in some])
    ax.barh(y, np.full(len(some), 100.0), 0.7, color=WITHOUT, label="without control, worst sample")
    shares = 100 * np.array([own.sampled or 0.0 for own in some]) / without
    ax.barh(y, shares, 0.36, color=SAMPLED, label="with this law, worst sample")
    proved = 100 * np.array([float(own.level or 0) for own in some]) / without
    ax.plot(proved, y, "|", color=PROVED, ms=20, mew=2.5, label="with this law, proved for all")
    for own, at, share in zip(some, y, proved, strict=True):
        ax.annotate(
            typeset(own.texts[0]), (max(share, 100), at), (7, 0), textcoords="offset points",
            va="center", fontsize=9,
        )  # fmt: skip
    ax.set_yticks(y, [typeset(plainly(own.what)) for own in some])
    ax.set_xlim(0, 1.45 * max(100.0, proved.max()))
    ax.set_xlabel("share of the worst without control [%]")
    ax.grid(axis="y", visible=False)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def plainly(what: str) -> str:
    """Return words with names that are out of their quotes, where they stand alone: in a cell."""
    return re.sub(r"'([\w ./-]+)'", r"\1", what)
