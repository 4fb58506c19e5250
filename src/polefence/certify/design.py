"""A design: a law, the region it is for and the certificate that proves it; saved and loaded."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from polefence.base.beside import say_beside
from polefence.base.drawing import pictures
from polefence.base.errors import DesignFileError, InputError, NotProvedError
from polefence.base.explained import explained
from polefence.base.files import read_text, write_documents
from polefence.certify.certificate import Certificate, Check, decide, plant_of
from polefence.certify.evaluation import rounding_share, surely_runs
from polefence.certify.lyapunov import lyapunov_matrix, weights_at
from polefence.law.laws import Law
from polefence.lmi.conditions.methods import Scheduled, Slack, method_label
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.claims.base import Claim, Verdict, prove
from polefence.proof.claims.observer import Observer
from polefence.proof.claims.poles import Poles
from polefence.proof.document import Document, loads, says_proof
from polefence.proof.document import check as check_claims
from polefence.proof.reading import MAX_BYTES
from polefence.proof.short import Short
from polefence.proof.work import FormatError
from polefence.region.regions import Region

FILE_NAME = "design.json"
OF_DAMPERS = "law.json"  # of a law of controllable dampers, which is no `Design`


@dataclass(frozen=True, eq=False, repr=False)
class Design(Short):
    """A law with the region it is for and the certificate that proves it.

    Attributes
    ----------
    certificate : Certificate
    proved : bool
        False only where the caller asked for it with ``allow_unproved=True``.
    lower : float, optional
        A radius [1/s] at which the method's inequalities are proved infeasible, for any law; where
        `tightest` found one. It is no bound for other methods.
    unrunnable : float, optional
        What `tightest` proved too, but only of a law that doubles cannot evaluate, see ``runs``: a
        smaller radius or larger decay rate [1/s], or a larger damping ratio.
    more : tuple of Claim
        What is proved besides, of estimates that are off; saved with it.
    asked : Region, optional
        In discrete time, the half-plane or sector within whose image in the z-plane the region is,
        where `tightest` found the largest decay rate or damping ratio.
    """

    certificate: Certificate
    proved: bool = True
    lower: float | None = None
    unrunnable: float | None = None
    more: tuple[Claim, ...] = ()
    asked: Region | None = None

    def __repr__(self) -> str:
        status = "proved" if self.proved else "not proved"
        return f"<Design of {self.plant.name!r}: {self.method}, {self.region}, {status}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        status = "proved" if self.proved else "not proved"
        rows = [
            ("poles", f"{status}: in {self.region}" if self.proved else status),
            ("method", self.label),
            ("note", self.note.removeprefix("note: ")),
            ("beside", "" if self.plant.data is None else self.plant.data.note),
        ]
        return card(self.plant.name, rows, self.plot().small if self._is_drawn else "")

    @property
    def _is_drawn(self) -> bool:
        """Whether it has a picture: one of an observer is about errors, and has none."""
        return self.proved and not self.certificate.observer

    def plot(self) -> Any:
        """Return a picture of the closed-loop poles over the family, with the region.

        Returns
        -------
        Picture
            A notebook shows it; ``save(path)`` writes it as PNG, SVG or PDF.

        Raises
        ------
        DesignFileError
            If the design is an observer's.
        """
        require_kind(self.certificate)
        return pictures().poles(self)

    def step(self) -> Any:
        """Return a picture of all signals after a unit step of the first disturbance, or input.

        Returns
        -------
        Picture
            As `plot` returns.

        Raises
        ------
        DesignFileError
            If the design is an observer's.
        InputError
            If no response can be drawn.
        """
        require_kind(self.certificate)
        return pictures().step(self)

    def bode(self, place: str = "") -> Any:
        """Return Nyquist, Bode and Nichols plots of the loop, opened at one place.

        Parameters
        ----------
        place : str
            An input or a signal that the law measures, by name; by default the first input.

        Returns
        -------
        Picture
            As `plot` returns.

        Raises
        ------
        DesignFileError
            If the design is an observer's.
        InputError
            If there is no loop of that name.
        """
        require_kind(self.certificate)
        return pictures().bode(self, place)

    @property
    def plant(self) -> UncertainPlant:
        """The plant family."""
        return self.certificate.plant

    @property
    def law(self) -> Law:
        """The control law, u = K(alpha) x."""
        return self.certificate.law

    @property
    def region(self) -> Region:
        """The region that holds all closed-loop poles."""
        return self.certificate.region

    @property
    def method(self) -> str:
        """The condition that was used."""
        return self.certificate.method

    @property
    def label(self) -> str:
        """The method with degree, elevation and domain: "scheduled(2, 1, box)"."""
        law, evidence = self.law, self.certificate.evidence
        if self.method == "slack" and "degree" in evidence:
            return method_label(Slack(evidence["degree"], evidence["elevation"], evidence["on"]))
        if self.method == "scheduled" and law.W is not None:
            method = Scheduled(law.degree, evidence.get("elevation", 1), law.domain.on)
            return method_label(method)
        return self.method

    @cached_property
    def rounding(self) -> float:
        """Share of the room in the region that rounding in doubles takes, see `rounding_share`.

        The proof is about K(alpha) as a real number. This is judged in floats, at corners and some
        points between; `polefence export` proves it of the code.
        """
        return rounding_share(self.certificate)

    @cached_property
    def runs(self) -> bool:
        """Whether the law still keeps the poles in the region when doubles evaluate it."""
        return (self.proved and surely_runs(self.certificate)) or self.rounding <= 1

    @property
    def note(self) -> str:
        """A line about a law that doubles cannot evaluate; else empty."""
        if self.runs:
            return ""
        return (
            f"note: evaluated in doubles this law does NOT keep the poles there: {self._taken}; "
            "ask for a slightly larger region, or one that bounds the poles' speed, such as a disk"
        )

    @property
    def _taken(self) -> str:
        if not math.isfinite(self.rounding):
            return "rounding takes all the room there is"
        return f"rounding takes {self.rounding:.2g} times the room there is"

    @explained
    def poles(self, alpha: Array) -> Array:
        """Closed-loop poles at points alpha (..., N) of the simplex, as (..., n) complex."""
        A, B = self.plant.at(alpha)
        return np.asarray(np.linalg.eigvals(A + B @ self.law.gain(alpha)))

    @explained
    def lyapunov_at(self, alpha: Any = None, part: int = 0, /, **values: Any) -> Array:
        """Return the Lyapunov matrix P of the proof at one point, as ``lyapunov_at(m1=300)``.

        V = x'P x falls along every motion of the loop A_c there. With the L and M of a part of the
        region, L (x) P + M (x) P A_c + M' (x) A_c'P < 0 proves the poles (M and M' may change
        places). A plant at samples is one of x(t + T) = A_c x(t): A_c'P A_c < P.

        Parameters
        ----------
        alpha : (N,) array, optional
            Weights of the vertices, in place of the parameters' values.
        part : int
            Number of the part of the region, which has a matrix of its own where the method is
            "lyapunov".
        **values : number
            Of every parameter, in its unit.

        Returns
        -------
        (n, n) array
            Symmetric, positive definite; computed exactly, then rounded.

        Raises
        ------
        InputError
            If the point is none of the family, or there is no such part.
        """
        claim = self.certificate.claim()
        if part not in range(len(claim.region)):
            most = len(claim.region) - 1
            raise InputError(f"part = {part!r}: the region's parts are 0 to {most}")
        evidence = claim.evidence[part if len(claim.evidence) > 1 else 0]
        weights = weights_at(self.plant.parameters, len(claim.A), alpha, values)
        return lyapunov_matrix(claim.law, claim.sizes, evidence, weights)

    def to_control(self, given: str = "", name: str = "law", clamp: bool = True) -> Any:
        """Return the law as a system of python-control without states, to connect and simulate.

        Parameters
        ----------
        given : str
            "parameters", in their units, or "alpha", one weight a vertex; by default the parameters
            where the plant has some, and nothing for one gain.
        name : str
            Of the system.
        clamp : bool
            What lies outside the family is taken at the nearest bound, as linearising and steps of
            a solver need; else it is refused.

        Returns
        -------
        control.StateSpace or control.NonlinearIOSystem
            The first, without states, for one gain. Inputs: the states, under their names without
            units in letters, digits and _ (``x1`` and so on where the plant has none), then what
            schedules the law: the parameters, or ``alpha1`` and so on. Outputs: the plant's inputs
            u = K x, likewise (``u1``).

        Raises
        ------
        InputError
            If ``given`` is neither, the plant has no parameters, or the design is an observer's.
        MissingExtraError
            If python-control is not installed.
        """
        require_kind(self.certificate)
        from polefence.law.control import law_to_control  # deferred: an extra

        return law_to_control(self.plant, self.law, given, name, clamp)

    def as_law(self) -> Law:
        """Return the law, to be closed around a plant.

        Raises
        ------
        DesignFileError
            If it is an observer's.
        """
        require_kind(self.certificate)
        return self.law

    @property
    def checkable(self) -> Self:
        """The design, where `check` proves its file, or nothing is said to be proved.

        Raises
        ------
        NotProvedError
            Saying why it does not.
        """
        if self.proved:
            self.certificate.require_checkable(self.more)
        return self

    @explained
    def save(self, directory: str | Path) -> Path:
        """Write ``design.json`` into a folder, made if need be; return its path.

        What is written as proved is proved by the checker first, whoever proved it before.

        Raises
        ------
        NotProvedError
            If the checker does not prove what this design says is proved.
        OutputError
            If the folder cannot be written, or has another's file of this name; nothing is left
            half-written.
        """
        certificate = self.checkable.certificate
        claims = (certificate.claim(), *self.more) if self.more else None
        documents = {FILE_NAME: certificate.file(claims).dumps()}
        return write_documents(Path(directory), documents)[0]

    @classmethod
    @explained
    def load(
        cls, path: str | Path, allow_unproved: bool = False, *, observer: bool = False
    ) -> Design:
        """Read a design file and prove it afresh; with ``observer`` one that `Observer` wrote.

        Raises
        ------
        DesignFileError
            If it cannot be read, or is an observer's where a law is wanted, or the other way.
        NotProvedError
            If its claim is not proved, unless ``allow_unproved``.
        """
        return cls.read(path, observer=observer).afresh(path, allow_unproved)

    @classmethod
    @explained
    def read(
        cls, path: str | Path, *, observer: bool = False, document: Document | None = None
    ) -> Design:
        """Read a design file and prove nothing, which may take long: it is not ``proved`` yet.

        Parameters
        ----------
        document : Document, optional
            What is in the file, where it has been read.

        Raises
        ------
        DesignFileError
            As `load` raises.
        """
        where = _design_path(path)
        if document is None:
            document = read_document(where)
        try:
            certificate = Certificate.of(document)
            require_kind(certificate, observer)
        except InputError as error:
            raise DesignFileError(f"{where}: {error}") from error
        return cls(certificate, proved=False)

    def afresh(self, path: str | Path, allow_unproved: bool = False) -> Design:
        """Return what was read from a file with its proof, which is looked at once.

        Raises
        ------
        DesignFileError, NotProvedError
            As `load` raises.
        """
        where = _design_path(path)
        try:
            verdict = self.certificate.prove()
        except InputError as error:
            raise DesignFileError(f"{where}: {error}") from error
        if not verdict.proved and not allow_unproved:
            raise NotProvedError(f"{where}: not proved: {verdict.reason}")
        return replace(self, proved=verdict.proved)


@explained
def check(source: str | Path | Certificate | Design) -> Check:
    """Prove a file of claims, a certificate or a design afresh, in exact arithmetic.

    Parameters
    ----------
    source : path, Certificate or Design
        A path may be that of a folder with a ``design.json``.

    Returns
    -------
    Check
        "proved"; "refuted", with the alpha whose poles leave the region; or "undecided".

    Raises
    ------
    DesignFileError
        If the file cannot be read as one of claims.
    """
    if isinstance(source, Certificate):
        source = Design(source)
    if isinstance(source, Design):
        answer = source.certificate.check()
        same = source.proved == answer.proved
        return _noted(answer, source if same else replace(source, proved=answer.proved))
    path = _design_path(source)
    return check_document(read_document(path), path)


def read_document(path: Path) -> Document:
    """Read a file of claims; proves nothing.

    Raises
    ------
    DesignFileError
        If it cannot be read as one.
    """
    if path.suffix == ".toml" and path.is_file():
        raise DesignFileError(
            f"{path}: a spec, but a design is needed: `polefence design -o DIR` writes one"
        )
    text = read_text(path, MAX_BYTES, DesignFileError)
    try:
        document = loads(text)
    except FormatError as error:
        raise DesignFileError(f"{path}: {error}") from error
    if document.plant.data is not None:
        say_beside(document.plant.data.note)
    return document


def proved_design(source: str | Path) -> tuple[Design, Document]:
    """Return a design and its file, all of whose claims are proved afresh.

    Raises
    ------
    DesignFileError
        If the file cannot be read, or is an observer's.
    NotProvedError
        If a claim is not proved.
    """
    path = _design_path(source)
    document = read_document(path)
    design = Design.read(path, document=document)
    answer = check_document(document, path, design.certificate)
    if not answer.proved:
        raise NotProvedError(f"{path}: {answer}")
    return design.afresh(path), document


def check_document(document: Document, path: Path, certificate: Certificate | None = None) -> Check:
    """Prove every claim of a file; look for a counterexample where poles are not proved.

    Parameters
    ----------
    certificate : Certificate, optional
        Of its poles, which are then proved as its claim, once.

    Raises
    ------
    DesignFileError
        If a claim is inconsistent, or they are more work than is done.
    """
    alphas = list[tuple[Fraction, ...]]()

    def decided(claim: Claim) -> Verdict:
        poles = claim.dual if isinstance(claim, Observer) else claim
        if not isinstance(poles, Poles):
            return prove(claim)
        if certificate is not None and poles == certificate.claim():
            verdict = certificate.prove()
            if verdict.proved:
                return verdict
        verdict, alpha = decide(poles)
        alphas.extend([alpha] if alpha else [])
        return verdict

    try:
        plant_of(document.plant)  # a plant that is none is no plant of a claim
        checked = check_claims(document, decided)
        alpha = alphas[0] if alphas else None
        answer = Check(checked.answer, checked.reason, alpha, checked.claims, checked.verdicts)
        if not answer.proved or document.first(Poles) is None:
            return answer
        return _noted(answer, Design(Certificate.of(document)))
    except (FormatError, InputError) as error:
        raise DesignFileError(f"{path}: {error}") from error


def _noted(answer: Check, design: Design) -> Check:
    """Say of a proved law that doubles cannot evaluate it, where they cannot."""
    if not answer.proved or design.runs:
        return answer
    note = design.note.removeprefix("note: ")
    return replace(answer, reason=f"{answer.reason}; but {note}")


def require_kind(certificate: Certificate, observer: bool = False) -> None:
    """Refuse an observer where a law is wanted, and a law where an observer is.

    Raises
    ------
    DesignFileError
        With what to do instead.
    """
    if certificate.observer and not observer:
        raise DesignFileError(
            f"{certificate.plant.name}: an observer, not a law: "
            "its gain is -L' of the dual plant; "
            "`polefence check` proves it, `polefence export` takes it as --observer"
        )
    if observer and not certificate.observer:
        raise DesignFileError(
            f"{certificate.plant.name}: a law, not an observer; `polefence observe` designs one"
        )


def is_proof_file(path: Path) -> bool:
    """Whether a file says that it is one of claims; what cannot be read says nothing."""
    if not path.is_file():
        return False
    try:
        return says_proof(read_text(path, MAX_BYTES, DesignFileError))
    except DesignFileError:
        return False


def _design_path(path: str | Path) -> Path:
    """A design file, or the folder that `Design.save` wrote it into."""
    where = Path(path)
    if not where.is_dir():
        return where
    if not (where / FILE_NAME).is_file():
        if (where / OF_DAMPERS).is_file():
            return where / OF_DAMPERS
        others = sorted(other.name for other in where.glob("*.json"))[:3]
        has = f"; it has {', '.join(others)}" if others else ""
        raise DesignFileError(
            f"{where}: has no {FILE_NAME}; name the folder that `polefence design -o` wrote{has}"
        )
    return where / FILE_NAME
