"""Reference laws of a car beside a trade-off curve."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from polefence.base.errors import InputError
from polefence.design.rows import Row
from polefence.design.signals.sampled import sampled
from polefence.design.signals.tradeoff_file import SAMPLES
from polefence.design.signals.tradeoff_front import Asked, Front
from polefence.plant.points import seeded
from polefence.vehicle.reference_laws import lqr, passive, skyhook

REFERENCES = {"passive": passive, "skyhook": skyhook, "LQR": lqr}


def beside_reference_laws(front: Front) -> Front:
    """Return a trade-off of a car with those reference laws that are stable over the family.

    Of any other plant it is as it was.
    """
    if front.asked.plant.vehicle is None:
        return front
    return replace(front, references=tuple(_references(front.asked)))


def _references(asked: Asked) -> Iterator[Row]:
    alpha = seeded(asked.plant, SAMPLES)
    for name, law_of in REFERENCES.items():
        with suppress(InputError):
            law = law_of(asked.plant)
            both = (asked.over, asked.minimise)
            over, least = (sampled(asked.plant, law, s, alpha).worst for s in both)
            keeps = all(
                sampled(asked.plant, law, own, alpha).worst <= (own.at_most or 0.0)
                for own in asked.subject_to
            )
            yield {"name": name, "over": over, "minimise": least, "keeps": keeps}
