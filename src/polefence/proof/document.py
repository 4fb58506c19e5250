"""The one file of proofs: a plant, a law, and claims about them; read, written, and proved.

``{"format": "polefence-proof", "version": 2, "plant": {...}, "law": {...}, "claims": [...]}``, each
claim with its ``kind`` and its evidence. ``law`` is left out where claims bring their own.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from polefence.proof.claims.base import Claim, Verdict, counting, prove
from polefence.proof.claims.bump import BumpResponse
from polefence.proof.claims.cells import Cells, Interpolated, read_interpolated
from polefence.proof.claims.clipped import Clipped
from polefence.proof.claims.decay import Decay
from polefence.proof.claims.delay_margin import DelayMargin
from polefence.proof.claims.disk_margin import DiskMargin, Unmodelled
from polefence.proof.claims.each_gain import EachGain
from polefence.proof.claims.energy_peak import EnergyPeak
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.factor_margin import GainMargin, PhaseMargin
from polefence.proof.claims.failure import Failure
from polefence.proof.claims.free import ImpulseResponse, InitialResponse
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.gain_conflict import GainRefutation
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.gain_norm import GainNorm
from polefence.proof.claims.initial_peak import InitialPeak
from polefence.proof.claims.observer import Observer
from polefence.proof.claims.peak_to_peak import PeakToPeak
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rate import Rate
from polefence.proof.claims.refutation import RmsRefutation
from polefence.proof.claims.relative_rms import RelativeRms
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.rounding import Rounded
from polefence.proof.claims.sampled import Sampled
from polefence.proof.claims.samples import Samples
from polefence.proof.claims.saturation import Saturation
from polefence.proof.claims.sector import SectorBound
from polefence.proof.claims.step import StepResponse
from polefence.proof.claims.worst_gain import WorstCaseGain
from polefence.proof.laws import Law, read_law
from polefence.proof.plant import Plant
from polefence.proof.reading import Table, parse, require_shallow, shown
from polefence.proof.short import Short
from polefence.proof.work import FULL, MAX_FILE, MAX_IN_PARTS, FormatError, counted

FORMAT, VERSION = "polefence-proof", 2
# What earlier versions wrote.
EARLIER = tuple(
    f"polefence-{name}" for name in ("design", "performance", "service", "table", "export")
)

KINDS: Mapping[str, type[Claim]] = MappingProxyType(
    {
        claim.kind: claim
        for claim in (
            Poles,
            Observer,
            Rms,
            Decay,
            RelativeRms,
            EnergyPeak,
            InitialPeak,
            Saturation,
            Gain,
            DiskMargin,
            Unmodelled,
            GainMargin,
            PhaseMargin,
            DelayMargin,
            WorstCaseGain,
            SectorBound,
            StepResponse,
            InitialResponse,
            ImpulseResponse,
            BumpResponse,
            PeakToPeak,
            GainNorm,
            Estimate,
            GainError,
            EachGain,
            Rate,
            Sampled,
            Samples,
            Rounded,
            Cells,
            RmsRefutation,
            GainRefutation,
            Failure,
            Clipped,
        )
    }
)


@dataclass(frozen=True)
class Document(Short):
    """Contents of a file.

    Attributes
    ----------
    plant : Plant
    law : Law or Interpolated, optional
    claims : tuple of Claim
    on : str
        Domain of a law that is not fixed, "simplex" or "box".
    export : mapping, optional
        What exported code says of itself beside what is proved; no proof reads it.
    polefence : str
        The version that wrote it.
    """

    plant: Plant
    law: Law | Interpolated | None
    claims: tuple[Claim, ...]
    on: str = "simplex"
    export: Mapping[str, Any] | None = None
    polefence: str = ""

    def first(self, kind: type[Any]) -> Any:
        """Return the first claim of a kind, None where there is none."""
        return next((claim for claim in self.claims if isinstance(claim, kind)), None)

    def write(self) -> dict[str, Any]:
        """Return the file as plain data for JSON."""
        table: dict[str, Any] = {"format": FORMAT, "version": VERSION}
        table |= {"polefence": self.polefence} if self.polefence else {}
        table["plant"] = self.plant.write()
        if self.law is not None:
            table["law"] = self.law.write(self.on)
        table["claims"] = [claim.write() for claim in self.claims]
        return table | ({} if self.export is None else {"export": dict(self.export)})

    def dumps(self, indent: int | None = 1) -> str:
        """Return the text of the file."""
        return json.dumps(self.write(), indent=indent, allow_nan=False) + "\n"

    def require_checkable(self, known: Sequence[Claim] = ()) -> None:
        """Refuse a file that `check` would not prove; nothing is called proved before.

        Parameters
        ----------
        known : sequence of Claim
            Those that `prove` proved: up to `FULL` of them are not proved again, for each has the
            same bound of work in a file as alone.

        Raises
        ------
        FormatError
            If a claim is not proved, together they are too much work, or the file is not read back
            as it is.
        """
        document = loads(self.dumps(indent=None))
        if (document.plant, document.law, document.claims) != (self.plant, self.law, self.claims):
            raise FormatError("its file does not say what was proved")
        few = len(self.claims) <= FULL

        def prover(claim: Claim) -> Verdict:
            proved = few and any(claim == other for other in known)
            return Verdict("proved", "") if proved else prove(claim)

        answer = check(self, prover)
        if not answer.proved:
            raise FormatError(answer.reason)


def loads(text: str) -> Document:
    """Read the text of a file; proves nothing.

    Raises
    ------
    FormatError
        If it is no JSON, cut short, of another format or version, or malformed; saying where.
    """
    return from_plain(parse(text), parsed=True)


def from_plain(data: Any, parsed: bool = False) -> Document:
    """Read a file from plain data; see `loads`."""
    _require_format(data)
    with counted(MAX_FILE):
        return _read(Table.of(data if parsed else require_shallow(data)))


def _read(table: Table) -> Document:
    for key in ("format", "version"):
        table.at(key)
    plant = Plant.read(table.table("plant"))
    law, on = _read_law(table.table("law"), plant) if "law" in table else (None, "")
    claims = list[Claim]()
    for row in table.tables("claims", 100):
        # what reading one may take: of functions, that each part of the box has its polynomials
        with counted(MAX_IN_PARTS if plant.functions is not None else None):
            claim = KINDS[row.word("kind", KINDS)].read(row, plant, law, on)
            if plant.late is not None:
                claim.require_late(plant.late)
            claims.append(claim)
    if law is not None and not any(claim.of_law for claim in claims):
        raise FormatError("law: none of the claims is about it; take it out")
    remainder = plant.remainder
    sampled = remainder is not None and remainder.source is None
    curved = sampled and remainder is not None and (remainder.curve or remainder.bends)
    if curved and not any(isinstance(claim, Samples) for claim in claims):
        raise FormatError(
            "plant.remainder: a claim of kind samples has to say what the plant is of"
        )
    export = table.at("export") if "export" in table else None
    if export is not None and not isinstance(export, dict):
        raise FormatError("export must be a table")
    document = Document(plant, law, tuple(claims), on, export, table.text("polefence", ""))
    table.done()
    return document


def _require_format(data: Any) -> None:
    name = data.get("format") if isinstance(data, dict) else None
    if name in EARLIER:
        raise FormatError(
            f"{name} is a format of polefence 0.1, which is not read any more; "
            "design or export it again, and save that"
        )
    if name != FORMAT:
        other = f", not {shown(name)}" if isinstance(name, str) else ""
        raise FormatError(f'not a file of proofs: "format" must be "{FORMAT}"{other}')
    if type(data.get("version")) is not int or data["version"] != VERSION:
        raise FormatError(
            f"format version {shown(data.get('version'))} is not {VERSION}, the one read here; "
            "use a later release of polefence"
        )


def _read_law(table: Table, plant: Plant) -> tuple[Law | Interpolated, str]:
    kind = table.word("kind", ("fixed", "scheduled", "polynomial", "table"))
    if kind == "table":
        return read_interpolated(table, plant), ""
    law, on = read_law(table, plant)
    return law, plant.domain(on) if on else ""


def says_proof(text: str) -> bool:
    """Whether a text says that it is a file of proofs, of this version or an earlier one."""
    if not any(f'"{name}"' in text for name in (FORMAT, *EARLIER)):
        return False
    try:
        data = parse(text)
    except FormatError:
        return False
    written = data.get("format") if isinstance(data, dict) else None
    return written == FORMAT or written in EARLIER


@dataclass(frozen=True)
class Checked(Short):
    """Verdict on a file.

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
    with counted(MAX_FILE):  # of which each claim gets as much as it gets alone
        for number, claim in enumerate(document.claims, 1):
            verdict = prover(claim)
            if verdict.proved:
                verdict = verdict.unless(claim.fault_in(document.plant, document.claims))
            text = claim.said(document.plant)
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
    if not any(verdict.count for verdict in verdicts) or len(verdicts) == 1:
        return "; ".join(dict.fromkeys(verdict.reason for verdict in verdicts))
    notes = [verdict.note for verdict in verdicts if verdict.note]
    return "; ".join([counting(sum(verdict.count for verdict in verdicts)), *notes])
