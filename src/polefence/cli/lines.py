"""Sentences that several commands print about a plant, a region or a law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from polefence.certify.bounds import Bound
from polefence.certify.checks import decays, in_time_of
from polefence.certify.design import Design
from polefence.certify.refutation import Refutation
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.plant.exact import ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states as states_of_a_law
from polefence.proof.claims.decay import Decay
from polefence.proof.motion import is_late, motion_text
from polefence.proof.text import (
    digits_down,
    digits_up,
    exactly,
    late_text,
    milliseconds_text,
)
from polefence.region.regions import Region
from polefence.region.z_plane import shares
from polefence.requirements.rms import Rms
from polefence.requirements.specification import Specification

MOST_GAINS = 8  # vertices whose gains are printed one by one
LITTLE = 0.001  # % of a bound, below which no digits are printed


def order_lines(plant: UncertainPlant, structure: Structure | None) -> list[str]:
    """Say that a law has fewer states than were asked for; nothing of any other."""
    order, states = 0 if structure is None else structure.order, states_of_a_law(plant)
    if states >= order:
        return []
    return [
        f"  a law of order {states}: none of order {order} that was found is better by a thousandth"
    ]


def samples_text(plant: UncertainPlant, asked: Sequence[Specification] = ()) -> list[str]:
    """Say what the samples of a plant are, that a law was designed for; nothing of any other.

    Parameters
    ----------
    asked : sequence of Specification
        What is bounded: some of it may hold between samples too.
    """
    sampling = plant.sampling
    if sampling is None or plant.sample_time is None:
        return []
    time, late = milliseconds_text(plant.sample_time), ""
    if sampling.delay:
        late = f", inputs act {late_text(sampling.late)}"
    always = [one for one in asked if not one.has_primal(plant)]
    if not always:
        return [
            f"  at samples every {time} ms, not between them; inputs and disturbances held{late}"
        ]
    rms = [one for one in asked if isinstance(one, Rms)]
    none = " or ".join(key for key in ("weight", "band") if any(getattr(one, key) for one in rms))
    kinds = dict.fromkeys(one.kind for one in always)
    which = " and ".join(
        f"{kind} without {none}" if none and kind == "rms" else kind for kind in kinds
    )
    if sampling.clock is None:
        return [f"  inputs held for {time} ms{late}; {which} at all times, all else at samples"]
    if sampling.early:
        late += f", {milliseconds_text((1 - sampling.early) * plant.sample_time)} ms after a sample"
    return [
        f"  inputs held for {sampling.clock.text(plant.sample_time)} in any order{late}: "
        f"{which} at all times, and the loop is stable; all else at samples every {time} ms"
    ]


def decay_lines(decay: Decay | None) -> list[str]:
    """Say how fast a loop decays for the periods that `samples_text` names; nothing of none."""
    if decay is None:
        return []
    rate = digits_down(float(decay.level))
    return [f"  for these periods in any order the loop decays by exp(-{rate} t)"]


def decay_of(decay: Decay | None) -> dict[str, float | None]:
    """Return the same as plain data."""
    return {"decay in any order": None if decay is None else float(decay.level)}


def motion_lines(
    plant: UncertainPlant, region: Region, bounds: bool = False, exact: bool = False
) -> list[str]:
    """Say what holds while parameters move; nothing of a plant whose parameters do not.

    With ``exact`` that it does of exact estimates, where a law is for others too.
    """
    how = motion_text(ranges_of(plant))
    if not how:
        return []
    if is_late(ranges_of(plant)):
        return [f"  with {how}; all parameters are constant"]
    lines = ["  the poles are for constant parameters"]
    kept = ["the bounds hold"] * bounds
    if decay := _decay_text(plant, region):
        kept.append(f"the loop {decay}")
    if kept:
        estimates = ", of exact estimates," * exact
        return [f"{lines[0]}; with {how}{estimates} {' and '.join(kept)}"]
    return [
        *lines,
        f"note: nothing is proved for {how}; add & half_plane(0) to the region, or ask for bounds",
    ]


def _decay_text(plant: UncertainPlant, region: Region) -> str:
    """Say how fast motions decay in a region; "" where it says nothing of them."""
    rates = decays(plant, region)
    if not rates:
        return ""
    if plant.sample_time is not None:
        fast = f"decays by {digits_up(min(rates))}^k in k samples"
        return fast if min(rates) < 1 else "is exponentially stable"
    decay = max(rates)
    if decay > 0:
        return f"decays by exp(-{digits_down(decay)} t)"
    if decay < 0:
        return f"grows by no more than exp({digits_up(-decay)} t)"
    return "is exponentially stable"


def every_alpha(design: Design, *others: str) -> str:
    """Say for which alpha a design is proved: on a box not for every point of the simplex.

    ``others`` are the domains of what is proved besides.
    """
    box = "box" in (design.certificate.claim().on, *others)
    return "every alpha of the box" if box else "every alpha"


def image_text(plant: UncertainPlant, region: Region, proved: bool = True) -> list[str]:
    """Say what stands in the z-plane for a region that is asked of a plant in discrete time."""
    if plant.sample_time is None or in_time_of(plant, region) == region:
        return []
    T = float(plant.sample_time)
    kept = shares(region, T)
    said = "".join(f"; {share}" for share in kept)
    lines = [f"  that lies within {region} at T = {exactly(T)} s, z = exp(s T){said}"]
    if not proved:
        lines += [
            f"  note: so a pole outside that {share.name} may still be in {share.beyond} asked"
            for share in kept
        ]
    return lines


def smaller_text(plant: UncertainPlant, region: Region) -> list[str]:
    """Say what `image_text` says where that is less than the image of what was asked."""
    T = plant.sample_time
    return image_text(plant, region) if T is not None and shares(region, float(T)) else []


def gains_of(law: Law) -> dict[str, Any]:
    """Return the gain, that of each term of a polynomial, or that at each vertex, as plain data."""
    return {name: K.tolist() for name, K in law.named_gains().items()}


def words_of(law: Law) -> dict[str, Any]:
    """Return what the gains of a law stand for, as plain data; nothing where names say it."""
    return {"formula": law.formula, "where": law.definitions} if law.formula else {}


def law_lines(law: Law) -> list[str]:
    """Return a law in lines: its gains, of a polynomial what they are and stand for."""
    gains = gains_of(law)
    if not law.formula or (not law.degree and not law.measured):
        return gain_lines(gains)
    return [f"  {line}" for line in (law.formula, *law.definitions)] + _matrices(gains)


def _matrices(gains: Mapping[str, list[list[float]]]) -> list[str]:
    return [f"  {label} = {matrix_text(K)}" for label, K in gains.items()]


def gain_lines(gains: Mapping[str, list[list[float]]]) -> list[str]:
    """Return gains in lines; of many vertices the least and the greatest entries alone."""
    if len(gains) <= MOST_GAINS:
        return _matrices(gains)
    letter, every = next(iter(gains)).split()[0], np.array(list(gains.values()))
    where = f"  {letter} at {len(gains)} vertices"
    return [
        f"{where}, the least entries = {matrix_text(every.min(axis=0))}",
        f"{where}, the greatest entries = {matrix_text(every.max(axis=0))}",
        "  note: --json FILE has them all",
    ]


def matrix_text(rows: Any) -> str:
    """Print a matrix in a line, its rows separated by semicolons."""
    return "[" + "; ".join(" ".join(f"{e:.6g}" for e in row) for row in rows) + "]"


def errors_text(bound: Bound) -> str:
    """Say what enclosing functions of the parameters takes of a bound; "" where there are none."""
    if bound.errors is None:
        return ""
    share = 100 * bound.errors
    takes = f"{digits_up(share, 2)} %" if share >= LITTLE else f"under {LITTLE} %"
    return f"; enclosing the functions takes {takes} of it"


def limit_lines(limit: Refutation | None, proved: float, of: str = "this one") -> list[str]:
    """Say what no law goes below, and what that leaves of a bound that is proved."""
    if limit is None:
        return []
    least, *others = limit.specifications
    level, names = float(least.at_most or 0.0), [one.title for one in others]
    within = f" within the {'limits' if len(names) > 1 else 'limit'} on {' and '.join(names)}"
    above = max(100 * (proved / level - 1), 0.01)
    share = digits_up(above, 2 if above > 0.1 else 1)
    return [
        f"  proved: no law, of any order and whatever it measures, goes below "
        f"{digits_down(level, 5)} at {limit.where}{within * bool(names)}; {of} is at most "
        f"{share} % above"
    ]


def limit_of(limit: Refutation | None) -> dict[str, Any] | None:
    """Return what no law goes below as plain data."""
    if limit is None:
        return None
    least, *others = limit.specifications
    return {
        "least": least.at_most,
        "vertex": limit.vertex + 1,
        "where": limit.where,
        "within": [one.title for one in others],
    }
