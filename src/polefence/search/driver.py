"""The search for a law with a proof: laws of a source, each certified; the first, or the best.

A source finds laws in floats, of a plant that floats can search: of combinations of its vertices,
for parameters at rest. What is certified is what was asked: the region, of the whole plant. A law
on the edge of a region has no proof, so laws are sought for a tighter one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from operator import attrgetter
from typing import Any

import numpy as np

from polefence.base import effort
from polefence.base.errors import InputError, NotProvedError
from polefence.certify.candidates import edge, preferred
from polefence.certify.checks import stable_region
from polefence.certify.design import Design
from polefence.certify.evidence import FORMS, certificate_of, evidence_at
from polefence.certify.given import analyse
from polefence.law.laws import Law
from polefence.lmi.conditions.methods import Method, Scheduled
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.region.regions import Disk, HalfPlane, Region, Sector
from polefence.response.closed import close

# How near to the worst sample a region is proved, as one over the share that it is wider: mostly as
# near as can be; less where doubles cannot run that, where parameters move or the plant has a
# remainder. Halvings in between.
NEAREST, FARTHEST, WIDENINGS = 1e6, 1.1, 12
NUMBERS = {"disk": "radius", "half_plane": "decay", "sector": "damping"}
# Of the way from a smallest disk to the unit circle: where laws for a remainder are sought. Of 32
# searches, of two cars, a servo and two masses sampled every 10 to 200 ms, each has the least
# radius of some; four more shares in between come 1 % lower at most.
FARTHER = (0.0, 0.01, 0.05, 0.1, 0.3, 0.6, 0.9)


@dataclass(frozen=True, eq=False)
class Source:
    """Where laws come from, and what proves them.

    Attributes
    ----------
    plant : UncertainPlant
        Of which they are proved.
    laws : callable
        Of a region: what is found for it, with its ``law``, the most promising first. It raises
        NotProvedError, saying why, where there is none for smaller regions either.
    certified : callable
        Of what was found and a region: the proof that it keeps it, None where there is none.
    refusal : callable
        Of a region: what is said where laws were found, and none is proved.
    shares : tuple of float
        By how much tighter regions are asked for. Of 290 laws of LMIs, with a remainder and
        without, the first had a proof for the very region.
    """

    plant: UncertainPlant
    laws: Callable[[Region], Iterable[Any]]
    certified: Callable[[Any, Region], Design | None]
    refusal: Callable[[Region], NotProvedError]
    shares: tuple[float, ...] = (0.0,)


def placed(region: Region, *sources: Source) -> Design:
    """Return a law that is proved to keep a region, of the first source that has one.

    Of a source's laws it is the first that doubles can run, else the first.

    Raises
    ------
    NotProvedError
        If none is proved.
    """
    refusals = list[NotProvedError]()

    def designs(source: Source) -> Iterator[Design | None]:
        inside = stable_region(source.plant)
        for share in source.shares:
            searched = region.tighter(share, inside) if share else region
            for law in source.laws(searched):
                yield source.certified(law, region)
            if effort.ended():
                break

    for source in sources:
        try:
            design, _ = preferred(designs(source), attrgetter("runs"))
            if design is not None:
                return design
            refusals.append(source.refusal(region))
        except NotProvedError as refusal:
            refusals.append(refusal)
    raise refusals[0]


def on_the_box(plant: UncertainPlant, method: Method | None) -> Method:
    """Return the method that is meant by plain "scheduled", or none, of a plant with a curve.

    Its loop is to be a polynomial of the parameters.
    """
    method = method or "scheduled"
    if plant.curve_degree == 1 or not plant.parameters or method != "scheduled":
        return method
    return Scheduled(1, 1, "box")


def kept(plant: UncertainPlant, law: Law, region: Region) -> Design | None:
    """Return the proof that a law keeps a region, None where there is none."""
    with suppress(NotProvedError):  # more work than is checked
        answer = analyse(plant, law, region)
        return answer.design if answer.proved else None
    return None


def require_kind(of: str) -> None:
    """Refuse what is no kind of region.

    Raises
    ------
    InputError
        If it is none.
    """
    if of not in NUMBERS:
        raise InputError(f"of = {of!r} is unknown; use 'disk', 'half_plane' or 'sector'")


def kept_simply(plant: UncertainPlant, candidate: Any, region: Region) -> Design | None:
    """Return the proof of one part with a Lyapunov polynomial of low degree, if there is one."""
    for form in FORMS:
        evidence = evidence_at(plant, candidate.law, region, form)
        if evidence is not None:
            return Design(certificate_of(plant, candidate.law, region, [evidence]))
    return None


# --- regions of one number -----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Kind:
    """Regions of one number: disks about a centre, or half-planes and sectors within a region.

    Attributes
    ----------
    of : str
        "disk", "half_plane" or "sector".
    centre : float, optional
        In the plant's time.
    within : Region, optional
    """

    of: str
    centre: float | None = None
    within: Region | None = None

    def require(self) -> None:
        """Refuse what is no kind of region, or incomplete.

        Raises
        ------
        InputError
            Saying what is asked for.
        """
        require_kind(self.of)
        if (self.of == "disk") != (self.centre is not None):
            raise InputError("a disk needs a centre, a half-plane or a sector has none")
        if self.of == "disk" and self.within is not None:
            raise InputError("the smallest disk takes no region within")

    def region(self, value: float) -> Region:
        """Return the region of a number."""
        if self.centre is not None:
            return Disk(self.centre, value)
        region = HalfPlane(value) if self.of == "half_plane" else Sector(value)
        return region if self.within is None else region & self.within

    def number(self, design: Design) -> float:
        """Return the number of a design's region."""
        return float(design.region.parts[0].numbers[NUMBERS[self.of]])

    @property
    def sign(self) -> int:
        """Of what grows with the region."""
        return 1 if self.of == "disk" else -1

    def size(self, design: Design) -> float:
        """Return what is the less, the smaller the region is."""
        return self.sign * self.number(design)

    def wider(self, value: float, step: float, discrete: bool = False) -> float:
        """Return the number of a region a little wider, in discrete time up to the unit circle."""
        if self.centre is not None:
            room = 1 - abs(self.centre) - value if discrete else value
            return value + step * room
        if self.of == "half_plane":
            return value - step * max(abs(value), 1e-3)
        return max(value, 0.0) * (1 - step)

    def worst(self, poles: np.ndarray) -> float:
        """Return the number of the smallest region that holds poles."""
        if self.centre is not None:
            return float(np.abs(poles - self.centre).max())
        if self.of == "half_plane":
            return -float(poles.real.max())
        return float((-poles.real / np.abs(poles)).min())

    def runnable(self, designs: Iterable[Design | None]) -> Design | None:
        """Return the first whose law doubles can run, else the first; a smaller region is told."""
        design, sharpest = preferred(designs, attrgetter("runs"))
        if design is None or sharpest is None or self.size(sharpest) >= self.size(design):
            return design
        return replace(design, unrunnable=self.number(sharpest))

    def least(self, source: Source, candidate: Any, most: float = np.inf) -> Design | None:
        """Return the smallest region that a law is proved to keep, None where none near it is.

        Parameters
        ----------
        candidate : object
            What the source found.
        most : float
            The region is to be smaller than that of this `size`.
        """
        plant, T = source.plant, source.plant.sample_time
        poles = close(plant, candidate.law, seeded(plant, 500), disturbed=False).poles()
        worst = self.worst(poles if T is None else 1 + float(T) * poles)
        proved = list[Design]()

        def holds(near: float) -> bool:
            wider = self.wider(worst, 1 / near, T is not None)
            if self.sign * wider >= most:
                return True
            design = source.certified(candidate, self.region(wider))
            proved.extend([] if design is None else [design])
            return design is not None and design.runs

        if not holds(NEAREST):
            edge(holds, FARTHEST, NEAREST, WIDENINGS, geometric=True)
        proved.sort(key=self.size)
        return self.runnable(proved)

    def widened(self, source: Source, smallest: Design) -> Design | None:
        """Return the least region that is proved of laws of small ones: a remainder takes room.

        Parameters
        ----------
        smallest : Design
            Of the smallest region that a law was found for: wider ones have other laws.
        """
        number, discrete = self.number(smallest), source.plant.sample_time is not None
        best, most = None, np.inf
        for share in FARTHER:
            wider, laws = self.wider(number, share, discrete), list[Any]()
            if self.sign * wider >= most:
                break
            with suppress(NotProvedError):  # a tuned one may be found of a wider disk
                laws = [*islice(source.laws(self.region(wider)), 1)] if share else [smallest]
            for law in laws:
                best = self.least(source, law, most) or best
                most = np.inf if best is None else self.size(best)
        return best

    def climbed(
        self,
        attempt: Callable[[Region], Design],
        low: float,
        high: float,
        first: float | None = None,
        halvings: int = 24,
    ) -> Design:
        """Return the design of the largest number for which there is one.

        From a first number on it is doubled while there is one. Then the bracket is halved.

        Raises
        ------
        NotProvedError
            If there is none, with the last reason.
        """
        best: Design | None = None
        why: NotProvedError | None = None

        def holds(value: float) -> bool:
            nonlocal best, why
            try:
                best = attempt(self.region(value))
            except NotProvedError as error:
                why = error
                return False
            return True

        while first is not None and low < high:
            if not holds(first):
                high, first = first, None
                break
            low, first = first, min(2 * first, high)
        edge(holds, low, high, halvings, close=1e-3)
        if best is None:
            raise why or NotProvedError(f"not proved: no {self.of} could be proved")
        return best
