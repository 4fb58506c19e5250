"""Faults in claims with storage functions."""

from dataclasses import replace
from fractions import Fraction

from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError


def given(claim, **changed):
    """The claim with another part of its evidence."""
    evidence = replace(claim.subject.evidence, **changed)
    return replace(claim, subject=replace(claim.subject, evidence=evidence))


def times(M, factor):
    return [[Fraction(factor) * x for x in row] for row in M]


def stored(claim, k, **changed):
    """The claim with another stretch."""
    storage = list(claim.subject.evidence.storage)
    storage[k] = replace(storage[k], **changed)
    return given(claim, storage=tuple(storage))


def refused(claim):
    """Whether it is not proved."""
    try:
        return not prove(claim).proved
    except FormatError:
        return True
