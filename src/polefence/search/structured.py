"""Laws of a structure for a region, or for the smallest of a kind: tuned, then proved.

A plant in discrete time is searched in its delta form, in which floats see it as one in continuous
time, and proved there too where that is a proof of its samples.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

from polefence.base import effort
from polefence.base.errors import NotProvedError
from polefence.certify.checks import require_movable, require_region, stable_region
from polefence.certify.design import Design
from polefence.certify.given import analyse
from polefence.certify.measured import require_detectable
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.lmi.conditions.target import Decays, Disks, Goal, Sectors
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.delta import delta_form, sampled_form
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Region, bounded
from polefence.region.z_plane import delta_plane
from polefence.search.by_lmi import SPEED
from polefence.search.driver import Kind, Source, kept
from polefence.search.tune.dynamic import observers
from polefence.search.tune.tuner import Tuned, tune, tune_region
from polefence.search.tune.worth import NEAR

# Shares by which regions are asked for tighter than they are to be proved: a law on an edge has no
# proof. The first was enough for all of 30 laws, the second for three more of a spring that is
# sampled every 100 ms, whose remainder takes room; 1e-2 was not.
TIGHTER = (1e-3, 5e-2)


@dataclass(frozen=True, eq=False)
class Sought:
    """A law of a structure that is sought.

    Attributes
    ----------
    bare : UncertainPlant
        In its delta form, without the law's own states.
    plant : UncertainPlant
        In its own time, with them: the law is a gain of it.
    structure, gain : Structure
        Of the law, and of that gain.
    starts : list of Law
        From which searches begin, from wider regions to tighter ones.
    """

    bare: UncertainPlant
    plant: UncertainPlant
    structure: Structure
    gain: Structure
    starts: list[Law] = field(default_factory=list)

    @classmethod
    def of(cls, plant: UncertainPlant, structure: Structure, region: Region | None) -> Sought:
        """Return it; refuse a plant, a structure and a region that do not fit."""
        structure.require_fit(plant)
        require_region(plant, stable_region(plant) if region is None else region)
        require_movable(plant, region)
        require_detectable(plant, structure.outputs(plant), region)
        larger, gain = structure.extended(plant)
        return cls(delta_form(plant), larger, structure, gain)

    def __str__(self) -> str:
        return self.gain.words(self.plant)

    @property
    def source(self) -> Source:
        """Its laws for a region, the smallest gain first."""
        return Source(self.plant, self.laws, self.certified, self.refusal, TIGHTER)

    def laws(self, region: Region) -> list[Tuned]:
        """Return laws for a region in the plant's time."""
        T = self.plant.sample_time
        region = region if T is None else delta_plane(region, T)
        self.begin(region)
        return self._kept(tune(delta_form(self.plant), self.gain, None, (), region, self.starts))

    def begin(self, region: Region | None) -> None:
        """Have laws of the order to start from, if there are none."""
        if not self.starts:
            self.starts.extend(observers(self.bare, self.structure, (), region))

    def _kept(self, candidates: list[Tuned]) -> list[Tuned]:
        self.starts.extend(candidate.law for candidate in candidates[:1])
        return [candidate for candidate in candidates if candidate.kept]

    def certified(self, candidate: Tuned, region: Region) -> Design | None:
        """Return the proof that a law keeps a region in the plant's time."""
        T = self.plant.sample_time
        if T is None:
            return kept(self.plant, candidate.law, region)
        design = kept(delta_form(self.plant), candidate.law, delta_plane(region, T))
        with suppress(NotProvedError):
            return None if design is None else as_sampled(design, region)
        return None

    def refusal(self, region: Region) -> NotProvedError:
        """Return what is said where none is proved."""
        return NotProvedError(
            f"no {self} was found that is proved to keep all poles in {region}{effort.stopped()}"
        )

    def tightest(self, kind: Kind) -> Design | None:
        """Return the smallest region of a kind that is proved."""
        if kind.centre is None:
            within = bounded(kind.within, SPEED * typical_rate(delta_form(self.plant).A))
            kind = replace(kind, within=within)
        self.begin(kind.within)
        for share in (0.0, *TIGHTER) if kind.within is not None else (0.0,):
            goal = self._goal(kind, None if kind.within is None else kind.within.tighter(share))
            candidates = tune_region(delta_form(self.plant), self.gain, goal, (), self.starts)
            laws = self._kept(candidates)
            designs = (kind.least(self.source, law) for law in laws)
            design = next((proved for proved in designs if proved is not None), None)
            if design is not None or not laws or effort.ended():
                return design
        return None

    def _goal(self, kind: Kind, within: Region | None) -> Goal:
        """Return what grows: in discrete time, of the delta form, beyond the unit circle."""
        if kind.centre is None:
            return Decays(0.0, within) if kind.of == "half_plane" else Sectors(1.0, within)
        T = float(self.plant.sample_time or 0)
        if not T:
            return Disks(kind.centre, 0.0)
        centre = (kind.centre - 1) / T
        return Disks(centre, 1 / T - abs(centre + 1 / T))


def tightest(plant: UncertainPlant, structure: Structure, kind: Kind) -> Design:
    """Return the smallest region of a kind that is proved of a law of a structure.

    Raises
    ------
    NotProvedError
        If there is none.
    """
    sought = Sought.of(plant, structure, kind.within)
    best = sought.tightest(kind)
    if structure.order:  # more states are more room, and more places to get stuck
        with suppress(NotProvedError):
            below = tightest(plant, replace(structure, order=structure.order - 1), kind)
            if best is None or kind.size(below) - kind.size(best) <= NEAR * abs(kind.size(below)):
                best = below
    if best is None:
        raise NotProvedError(f"no {sought} with a proved {kind.of} was found{effort.stopped()}")
    return best


def as_sampled(design: Design, region: Region) -> Design:
    """Return a design that was found in the delta form as one of the plant in discrete time.

    Parameters
    ----------
    region : Region
        What was asked for, in the z-plane.

    Raises
    ------
    NotProvedError
        If a rounding of the region leaves no proof.
    """
    if not design.plant.step:
        return design
    plant = sampled_form(design.plant)
    certificate = replace(design.certificate, plant=plant, region=region)
    if certificate.holds():
        return Design(certificate)
    answer = analyse(plant, design.law, region)
    if answer.certificate is None or not answer.proved:
        raise NotProvedError(
            f"not proved: the law keeps {region} in the delta form, without a proof in the z-plane"
        )
    return Design(answer.certificate)
