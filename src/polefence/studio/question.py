"""What is asked for: a region and, if one likes, the best ride of what is measured; and the law."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from shlex import quote

from polefence.base.errors import DesignFileError, InputError
from polefence.certify.bounds import bounds_file
from polefence.certify.certificate import Certificate
from polefence.certify.design import FILE_NAME, Design, read_document, require_kind
from polefence.law.structure import Structure
from polefence.proof.document import Document
from polefence.proof.short import Short
from polefence.region.regions import Region
from polefence.requirements.specification import Specification, listed
from polefence.search.optimise import Optimised, optimise
from polefence.search.place import place
from polefence.studio.subject import Subject, Wanted

SCHEDULED = "scheduled"


@dataclass(frozen=True, eq=False)
class Found(Short):
    """A law that was found in floats, and what is claimed of it.

    Attributes
    ----------
    design : Design
    document : Document
        The file of the law and its claims.
    bounds : tuple of str
        What is claimed besides the region.
    """

    design: Design
    document: Document
    bounds: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Found:
        """Return what a design's file claims; it is proved by whoever asks.

        Raises
        ------
        DesignFileError
            If it cannot be read.
        """
        document = read_document(path / FILE_NAME if path.is_dir() else path)
        try:
            certificate = Certificate.of(document)
            require_kind(certificate)
        except InputError as error:
            raise DesignFileError(f"{path}: {error}") from error
        others = (claim.said(document.plant) for claim in document.claims[1:])
        return cls(Design(certificate), document, tuple(" ".join(text.split()) for text in others))

    @classmethod
    def of(cls, done: Design | Optimised) -> Found:
        """Return what was found."""
        if isinstance(done, Design):
            return cls(done, done.certificate.file())
        document = bounds_file(done.design.certificate, done.claims)
        return cls(done.design, document, tuple(map(str, done.bounds)))


@dataclass(frozen=True)
class Question(Short):
    """What is asked for.

    Attributes
    ----------
    region : Region
    measured : tuple of str
        Signals that the law measures.
    method : str
        One of `METHODS`. Of a law that is tuned: scheduled, or else one gain.
    ride : bool
        Whether what the spec minimises is to be the least, within its limits; else any law will do.
    over : str
        Title of the specification whose limit is another one than the spec's; empty for none.
    limit : float, optional
        That limit, in its unit; None for none.
    given : str
        The file of a design whose law is looked at, whatever else is said here; empty for a search.
    """

    region: Region
    measured: tuple[str, ...]
    method: str = SCHEDULED
    ride: bool = False
    over: str = ""
    limit: float | None = None
    given: str = ""

    @property
    def basis(self) -> Question:
        """The question of the ride with the spec's own limits: what comparisons begin from."""
        return replace(self, ride=True, over="", limit=None, given="")

    def structure(self, subject: Subject) -> Structure | None:
        """Return the structure of a law that is tuned; None of one of all states, by an LMI."""
        structure = subject.structure
        everything = len(self.measured) == subject.plant.shape[0] and self.measured == (
            subject.measured
        )
        if structure is None and everything and not self.ride:
            return None
        structure = structure or Structure(measured=subject.measured)
        if self.measured != subject.measured or structure.measured is None:
            structure = replace(structure, measured=self.measured)
        fixed = structure.schedule is None and self.method != SCHEDULED
        return replace(structure, schedule=()) if fixed else structure

    def others(self, wanted: Wanted) -> tuple[Specification, ...]:
        """Return the limits of the spec that are as they are."""
        return tuple(limit for limit in wanted.limits if limit.title != self.over)

    def search(self, subject: Subject) -> Found:
        """Search a law.

        Raises
        ------
        PolefenceError
            If there is none, or what is asked does not fit.
        """
        if self.given:
            return Found.read(Path(self.given))
        structure, wanted = self.structure(subject), subject.wanted
        if self.ride and wanted is not None:
            limits = (*self.others(wanted), *self._limited(subject))
            plant, region = subject.plant, self.region
            return Found.of(optimise(plant, wanted.least, limits, region, structure=structure))
        if structure is not None:
            return Found.of(place(subject.plant, self.region, structure=structure))
        return Found.of(place(subject.plant, self.region, self.method, allow_unproved=True))

    def _limited(self, subject: Subject) -> Iterable[Specification]:
        """Return what has the limit that was chosen."""
        if self.limit is None:
            return ()
        swept = (s for s in subject.overs if replace(s, at_most=None).title == self.over)
        return [replace(s, at_most=self.limit) for s in swept][:1]

    def options(self, subject: Subject) -> str:
        """Return the options of the command line for region, law and structure."""
        words = f"--region {quote(str(self.region))}"
        structure = self.structure(subject)
        if structure is None:
            return f"{words} --method {self.method}"
        if self.measured != subject.measured or subject.structure is None:
            words += f" --measured {quote(listed(self.measured)[1:-1])}"
        written = None if subject.structure is None else subject.structure.schedule
        return f"{words} --schedule none" if structure.schedule == () and written is None else words

    def command(self, subject: Subject) -> str:
        """Return the command line that designs this, or proves what is given."""
        if self.given:
            return f"polefence check {quote(self.given)}"
        name, options = quote(subject.name), self.options(subject)
        if not self.ride or subject.wanted is None:
            return f"polefence design {name} {options} -o design"
        words = "".join(f" {quote(word)}" for word in subject.wanted.words)
        for limit in self._limited(subject):
            words += f" --limit {quote(f'{limit.title} <= {self.limit!r}')}"
        return f"polefence optimise {name} {options}{words} -o design"

    def python(self, subject: Subject) -> str:
        """Return the Python that designs this, as lines that end with ``design``."""
        structure, wanted = self.structure(subject), subject.wanted
        lines = [
            "import polefence as pf",
            "",
            f"plant = pf.load({subject.name!r})",
            f"region = pf.parse_region({str(self.region)!r})",
        ]
        if self.given:
            return "\n".join([*lines, f"design = pf.Design.load({self.given!r})"])
        if structure is None:
            lines.append(f"design = pf.place(plant, region, {self.method!r})")
        else:
            lines.append(f"structure = {made(structure)}")
        if self.ride and wanted is not None:
            kept = (*self.others(wanted), *self._limited(subject))
            lines += [
                f"least = {made(wanted.least)}",
                f"limits = [{', '.join(map(made, kept))}]",
                "found = pf.optimise(plant, least, limits, region, structure=structure)",
                "design = found.design",
            ]
        elif structure is not None:
            lines.append("design = pf.place(plant, region, structure=structure)")
        return imported(lines)


def imported(lines: list[str]) -> str:
    """Return lines of Python behind the imports that values in them need."""
    needs = any("Fraction(" in line for line in lines)
    return "\n".join(["from fractions import Fraction\n", *lines] if needs else lines)


def made(asked: Specification | Structure) -> str:
    """Return the Python that makes it."""
    given = ((field, getattr(asked, field.name)) for field in fields(asked))
    words = (f"{field.name}={value!r}" for field, value in given if value != field.default)
    return f"pf.{type(asked).__name__}({', '.join(words)})"
