"""Check of a file of proofs: every claim of it, under one count of the work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from polefence.proof.claims.base import Claim, Verdict, counting, prove
from polefence.proof.document import Document
from polefence.proof.work import counted


@dataclass(frozen=True)
class Checked:
    """What is decided of a file.

    Attributes
    ----------
    answer : str
        "proved" if everything is; else that of the first claim that is not.
    reason : str
    claims : tuple of str
        What the answer is about, a line each, rounded so that it says no more: all claims that are
        proved, or the one that is not.
    verdicts : tuple of Verdict
        One a claim, as far as they were looked at.
    """

    answer: str
    reason: str
    claims: tuple[str, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def proved(self) -> bool:
        """Whether everything is proved."""
        return self.answer == "proved"


def check(document: Document, prover: Callable[[Claim], Verdict] = prove) -> Checked:
    """Prove every claim of a file in exact arithmetic.

    Parameters
    ----------
    prover : callable
        What decides a claim; `prove`, or it and a search for a counterexample.

    Raises
    ------
    FormatError
        If a claim is inconsistent, or the file asks for more work than is done.
    """
    said, verdicts = list[str](), list[Verdict]()
    with counted():  # one count for the file, however many its claims
        for number, claim in enumerate(document.claims, 1):
            verdict = prover(claim)
            if verdict.proved:
                verdict = verdict.unless(claim.fault_in(document.plant, document.claims))
            text = claim.statement(document.plant)
            verdicts.append(replace(verdict, claim=number))
            if not verdict.proved:
                return Checked(verdict.answer, _where(document, verdicts), (text,), tuple(verdicts))
            said.append(text)
    return Checked("proved", _reason(verdicts), tuple(said), tuple(verdicts))


def _where(document: Document, verdicts: list[Verdict]) -> str:
    """Say which claim is not proved, where there are several, and why not."""
    last = verdicts[-1]
    if len(document.claims) == 1:
        return last.reason
    return f"claim {last.claim}, {document.claims[last.claim - 1].kind}: {last.reason}"


def _reason(verdicts: list[Verdict]) -> str:
    """Add up what was proved."""
    if len(verdicts) == 1:
        return verdicts[0].reason
    notes = [verdict.note for verdict in verdicts if verdict.note]
    return "; ".join([counting(sum(verdict.count for verdict in verdicts)), *notes])
