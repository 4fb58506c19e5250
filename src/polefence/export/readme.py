"""The page of an export: how to call and check the code, and what is guaranteed of it."""

from __future__ import annotations

from polefence.design.certificate import Certificate
from polefence.design.design import Design
from polefence.export.c99.program import Program, Scheduled
from polefence.export.c99.sources import Texts, context, environment

README = "README.md"


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
