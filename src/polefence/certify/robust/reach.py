"""How far ranges may grow: a factor that is proved below one at which a plant of the box fails.

Where something is lost first is found in floats, and confirmed at rational values of the
parameters. The proofs begin just below it, so that one is enough where the evidence is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, require_type
from polefence.base.explained import explained
from polefence.base.files import write_documents
from polefence.base.processors import small_matrices
from polefence.base.progress import stage
from polefence.certify.bounds import Bound, best_bound, kept_bound
from polefence.certify.candidates import Deadline
from polefence.certify.checks import in_time_of, require_region
from polefence.certify.counterexample import refutes
from polefence.certify.decays import proved_decay
from polefence.certify.design import Design
from polefence.certify.evidence import (
    LADDER,
    MOST_IN_PART,
    MOST_WORK,
    Search,
    certificate_of,
    evidence_at,
    forms,
    placeholder,
    work_of,
)
from polefence.certify.given import Analysis, analysed, pole_at
from polefence.certify.interpolated import interpolated
from polefence.certify.robust.attained import attained, climbed, root_down
from polefence.certify.robust.breaking import (
    broken,
    decided,
    document_of,
    failure_at,
    known_exactly,
)
from polefence.certify.robust.edge import Lost, Rays, exceeded
from polefence.certify.robust.elements import broken_elements, factor_of
from polefence.certify.robust.family import (
    NEAR_END,
    Family,
    Growth,
    centre_of,
    is_disk,
    loops_of,
    short,
)
from polefence.law.compensator import beside
from polefence.law.laws import GainTable, Law
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.points import exact_alpha, joint, seeded, values_at
from polefence.plant.system import Array
from polefence.proof.claims.failure import Failure
from polefence.proof.document import Document
from polefence.proof.regions import parts_of
from polefence.proof.short import Short
from polefence.proof.work import FormatError
from polefence.region.regions import Disk, HalfPlane, Region
from polefence.requirements.margin import inverse
from polefence.requirements.sector import SectorBound
from polefence.requirements.specification import Specification, limit_text

CLOSE = 1e-5  # of a factor, between what is proved and what fails
# Below a factor that fails, shares of it by which a proof is tried; then halved between.
SHARES = (7e-6, 1e-4, 1e-3, 1e-2, 0.05, 0.2, 0.5, 0.8, 0.95)
HALVINGS = 8
# The same of limits that take long near their edge: of samples, of functions of the parameters,
# with a dead time, along motions. Of a van at 2 ms a proof takes 30 s at 2e-3 of the factor, of a
# loop of six states at 50 ms 1 minute at 7e-6.
COARSE = (5e-3, 0.02, 0.1, *SHARES[5:])
FEW = 1
# The same of poles where proofs fail near the edge, along motions or with a dead time; and where
# one that fails takes long, of functions of the parameters: of a van's table 50 s.
MOVED, SOME = (1e-4, 1e-3, 0.01, 0.1, *SHARES[6:]), 4
BENT, FEWER = (1e-3, 0.03, 0.3, 0.7, 0.95), 2
# The same where vertices are many, and one matrix of each is all that is tried: of three masses of
# seven parameters 0.5 of the factor that fails is proved so, 0.6 in two parts of the box.
WIDE = (0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95)
# Degree and elevation that prove most boxes near the edge, of one parameter that grows, of several;
# and how many parts of the box are tried then, before all else is.
FORM_OF_ONE, FORM, MOST_SOON = (1, 0), (1, 1), 4
# How far inside is enough there. Of two carts the least r is 1 - 7e-6: with 0.98 a proof takes 1.3
# times as long, and the range of k alone four parts of the box in place of two.
ENOUGH = 1 - 1e-6
BEYOND = (0.0, 1e-6, 3e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # what is lost in floats, by which it fails
HALVINGS_BETWEEN = 10  # between a plant of which it is not sure that it fails, and one that does
FINE = 2**30  # parts of a share that are told apart
SAMPLES = 2000  # points at which a signal is looked at
REFUTED, MARGINS = "refuted.json", "margins.json"  # files of what fails


@dataclass(frozen=True, eq=False, repr=False)
class Reach(Short):
    """How far some ranges may grow about their centres, in factors on their half-widths.

    Attributes
    ----------
    names : tuple of str
        The parameters whose ranges grow; those of others stay. None of a plant without parameters,
        whose factor is one where all is proved.
    proved : Fraction or None
        The largest factor that is proved; None where none is.
    refuted : Fraction or None
        The smallest one at which a plant of the box was found that fails; None where none was.
    values : dict of str to Fraction, or None
        That plant.
    reason : str
        What fails there.
    exact : bool
        Whether that is decided in exact arithmetic, and not in floats.
    top : Fraction
        Up to where was looked.
    end : str
        Why no farther, where the plant ends there.
    design : Design or None
        The proof at the largest factor, of the law on the box that it is of.
    """

    names: tuple[str, ...]
    proved: Fraction | None
    refuted: Fraction | None
    values: Mapping[str, Fraction] | None
    reason: str
    exact: bool
    top: Fraction
    end: str
    design: Design | None

    def __repr__(self) -> str:
        shown = ["none" if x is None else f"{float(x):.7g}" for x in (self.proved, self.refuted)]
        return f"<Reach of {', '.join(self.names)}: {shown[0]} proved, {shown[1]} refuted>"

    @property
    def whole(self) -> bool:
        """Whether it is proved up to where was looked: the factor is at least that."""
        return self.proved is not None and self.proved >= self.top


@dataclass(frozen=True, eq=False, repr=False)
class Attained(Short):
    """The worst case of a signal on the plant's own ranges: proved, beside what one plant has.

    Attributes
    ----------
    specification : Specification
    bound : Bound or None
        The least that is proved; None where none is.
    attained : float or None
        What the signal is, or more, at one plant; None where loops are unstable.
    values : dict of str to float, or None
        The parameters' values there.
    exact : bool
        Whether it is at least that in exact arithmetic; else it is sampled, in floats.
    frequency : float or None
        Of a gain, where it is that [rad/s].
    failure : Failure or None
        Of a margin, the claim that errors of that size make the loop unstable, and its proof.
    size : Fraction, optional
        That of the failure: what it makes the margin at most.
    """

    specification: Specification
    bound: Bound | None
    attained: float | None
    values: Mapping[str, float] | None
    exact: bool
    failure: Failure | None = None
    frequency: float | None = None
    size: Fraction | None = None

    def __repr__(self) -> str:
        level = "none" if self.bound is None else f"{self.bound.level:.6g}"
        reached = "none" if self.attained is None else f"{self.attained:.6g}"
        how = "attained" if self.exact else "sampled"
        return f"<Attained: {self.specification.title}, {level} proved, {reached} {how}>"


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(Short):
    """How far the ranges may grow before a region or a limit is lost.

    Attributes
    ----------
    plant, law
        What the question is about.
    region : Region
    limits : tuple of Specification
        What is to be kept.
    largest : Reach
        Of all ranges together.
    alone : dict of str to Reach
        Of each parameter, while the others keep their ranges.
    worst : tuple of Attained
        Of each signal that is asked about.
    refuted : str
        Why the law fails at the centre of the box; empty where it does not.
    """

    plant: UncertainPlant
    law: Law
    region: Region
    limits: tuple[Specification, ...]
    largest: Reach
    alone: Mapping[str, Reach]
    worst: tuple[Attained, ...]
    refuted: str = ""

    def __repr__(self) -> str:
        return f"<Robustness of {self.plant.name!r}: {self.largest!r}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        rows = [("all ranges", repr(self.largest)), *((k, repr(r)) for k, r in self.alone.items())]
        return card(
            self.plant.name, [*rows, *((w.specification.title, repr(w)) for w in self.worst)]
        )

    @property
    def proved(self) -> bool:
        """Whether all is proved on the plant's own ranges."""
        return self.largest.proved is not None and self.largest.proved >= 1

    @cached_property
    def failures(self) -> dict[str, Document]:
        """Files that prove what fails: ``refuted.json`` of ranges, ``margins.json`` of margins.

        One is left out where an exact proof is not one of a pole.
        """
        found = dict[str, Document]()
        reach, growth = self.largest, Growth(self.plant, self.law)
        if reach.values is not None and reach.refuted is not None and reach.exact:
            family = growth.at(dict.fromkeys(reach.names, reach.refuted))
            claim = _claim(family, self.region, self.limits, reach.values)
            found |= {} if claim is None else {REFUTED: document_of([claim])}
        broken = tuple(worst.failure for worst in self.worst if worst.failure is not None)
        return found | ({MARGINS: document_of(broken)} if broken else {})

    def save(self, directory: Any) -> Path:
        """Write proofs into a folder; return the path of the first.

        ``design.json`` is of the largest box that is proved, the others are those of `failures`.

        Raises
        ------
        InputError
            If nothing is proved.
        OutputError
            If the folder cannot be written.
        """
        documents = {name: document.dumps() for name, document in self.failures.items()}
        if self.largest.design is None and not documents:
            raise InputError("nothing is proved; there is nothing to save")
        paths = [] if self.largest.design is None else [self.largest.design.save(directory)]
        return [*paths, *write_documents(Path(directory), documents)][0]


@explained
@small_matrices()
def robust(
    plant: UncertainPlant,
    law: Any,
    region: Region | None = None,
    limits: Sequence[Specification] = (),
) -> Robustness:
    """Return how far the ranges of parameters may grow before a region or a limit is lost.

    Ranges grow about their centres, those of all parameters together, then that of each alone. The
    law keeps its formula: one that is scheduled on a parameter is the same polynomial beyond.

    Parameters
    ----------
    plant : UncertainPlant
        With parameters.
    law
        As `analyse` takes it, but no table.
    region : Region, optional
        For the poles; stability by default.
    limits : sequence of Specification
        Those with a limit, ``at_most``, are to be kept; of all the worst case is bounded.

    Raises
    ------
    InputError
        If law, region or limits do not fit the plant, or its ranges cannot grow.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    plant, given = beside(plant, law)
    if region is None:
        region = HalfPlane(0) if plant.sample_time is None else Disk(0, 1)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    region = in_time_of(plant, region)
    require_region(plant, region)
    for limit in limits:
        limit.require_fit(plant)
    if isinstance(given, GainTable):
        raise InputError(
            "a table of gains ends at its outer knots, and ranges cannot grow beyond them; give "
            "the gain, or the polynomial, that the table stands for"
        )
    growth = Growth(plant, given)
    if not growth.names and not limits:
        raise InputError(
            f"{plant.name} is given by one vertex, without parameters whose ranges could grow; "
            "give [parameter.NAME] tables, or limits whose worst case is asked about"
        )
    kept = tuple(limit for limit in limits if limit.at_most is not None)
    question = _Question(growth, region, kept)
    failed = question.at_centre()
    if failed:
        none = Reach(growth.names, None, Fraction(0), None, failed, True, Fraction(0), "", None)
        return Robustness(plant, given, region, kept, none, {}, (), failed)
    with stage("all ranges"):
        largest = question.reach(growth.names) if growth.names else question.as_it_is()
    alone = {growth.names[0]: largest} if len(growth.names) == 1 and not _others(growth) else {}
    for name in growth.names if not alone else ():
        with stage(f"range of {name} alone"):
            alone[name] = question.reach((name,), largest)
    worst = tuple(_worst(growth.at({}), limit) for limit in limits)
    return Robustness(plant, given, region, kept, largest, alone, worst)


def _others(growth: Growth) -> bool:
    return len(growth.plant.parameters) > len(growth.names)


@dataclass(frozen=True, eq=False)
class _Failed:
    """A plant at which something is lost, with the factor of the box that it is in.

    ``decidable`` is whether another plant, farther out, may be decided in exact arithmetic;
    ``sure`` whether it fails: of several loops what floats say is more than the truth.
    """

    factor: Fraction
    values: dict[str, Fraction]
    reason: str
    exact: bool
    decidable: bool = True
    sure: bool = True


@dataclass(frozen=True, eq=False)
class _Question:
    """What is to be kept, of what grows."""

    growth: Growth
    region: Region
    limits: tuple[Specification, ...]

    def at_centre(self) -> str:
        """Say what is lost at the centre of the box already; nothing where nothing is."""
        failed = self._at_centre
        return failed.reason if failed is not None and failed.sure else ""

    @cached_property
    def _at_centre(self) -> _Failed | None:
        shares = dict.fromkeys((p.name for p in self.growth.plant.parameters), Fraction(0))
        values = self.growth.values({}, shares)
        return self._fails(self.growth.at({}), values, Fraction(1))

    def as_it_is(self) -> Reach:
        """Return what is proved of a plant without parameters: a factor of one."""
        one = Fraction(1)
        proof = self._proof(Rays(self.growth, (), self.region, self.limits), one)
        design = proof if isinstance(proof, Design) else None
        proved = None if design is None else one
        return Reach((), proved, None, None, "", True, one, "", design)

    def reach(self, names: tuple[str, ...], known: Reach | None = None) -> Reach:
        """Return how far some ranges may grow.

        Parameters
        ----------
        known : Reach, optional
            Of more ranges, which says something of these where they are proved to grow.
        """
        end, said = self.growth.end(names)
        top = short(end * (1 - NEAR_END), up=False) if said else end
        rays = Rays(self.growth, names, self.region, self.limits, self._coarse)
        low, design = Fraction(0), None
        failed = self._at_centre
        if failed is None:
            lost, most, why = rays.first(top)
            if most < top:
                top, said = most, f"until there: {why}"
            failed = None if lost is None else self._confirmed(rays, lost)
            if known is not None and known.proved is not None and known.proved >= 1:
                low, design = min(known.proved, top), known.design
            if failed is not None and not failed.sure and self._apart:  # more than that is proved
                failed = self._surely(names, top, failed)
            if failed is not None and failed.factor <= low:  # in floats: what is proved is exact
                failed = None
            low, design, failed = self._proved(rays, low, design, failed, top)
        if failed is not None and not failed.sure:
            failed = self._surely(names, top, failed)
        return Reach(
            names,
            low or None,
            None if failed is None else failed.factor,
            None if failed is None else failed.values,
            "" if failed is None else failed.reason,
            failed is None or failed.exact,
            top,
            said,
            design,
        )

    def _surely(self, names: tuple[str, ...], top: Fraction, near: _Failed) -> _Failed | None:
        """Return a plant that is refuted, farther out than one of which that is not sure."""
        limits = tuple(limit.surely for limit in self.limits)
        known = limits != self.limits  # limits that are surely exceeded where they are in floats
        rays = Rays(self.growth, names, self.region, limits if known else (), self._coarse)
        lost = rays.first(top)[0]
        failed = None if lost is None else self._confirmed(rays, lost)
        if failed is None or not failed.sure:
            return None
        return failed if known else self._between(rays, near, failed)

    def _between(self, rays: Rays, near: _Failed, far: _Failed) -> _Failed:
        """Return the plant nearest to one of which it is not sure that surely fails."""
        parameters, grown = self.growth.plant.parameters, dict[str, Fraction]()
        for p in parameters:
            centre, half = centre_of(p)
            grown[p.name] = (near.values[p.name] - centre) / half
            grown[p.name] /= near.factor if p.name in rays.names else 1
        low, best = near.factor, far
        for _ in range(HALVINGS_BETWEEN):
            factor = short((low + best.factor) / 2, up=True)
            factors = rays.factors(factor)
            failed = None
            with suppress(InputError):
                values = self.growth.values(factors, grown)
                failed = self._fails(self.growth.at(factors), values, factor)
            if failed is not None and failed.sure and failed.exact:
                best = failed
            else:
                low = factor
        return best

    @cached_property
    def _apart(self) -> bool:
        """Whether floats weigh loops alike where a proof has scales of parts of the box."""
        plant, law = self.growth.plant, self.growth.law
        return any(limit.scales_apart(plant, law) for limit in self.limits)

    @cached_property
    def _coarse(self) -> bool:
        """Whether there are limits that take long near their edge."""
        plant = self.growth.plant
        moved = plant.dead_time is not None or bool(plant.moving)
        return bool(self.limits) and (moved or plant.remainder is not None)

    def _steps(self, enough: bool) -> tuple[tuple[float, ...], int, float]:
        """Return shares by which a proof is tried, halvings behind them, and what is close.

        Parameters
        ----------
        enough : bool
            Whether the ranges as they are are known to be proved.
        """
        plant = self.growth.plant
        moved = plant.dead_time is not None or bool(plant.moving)
        if self._coarse:
            return COARSE[1:] if enough else COARSE, FEW, 2 * COARSE[0]
        if plant.bent:
            return BENT, FEWER, 2 * BENT[0]
        if self._wide:
            return WIDE, SOME, WIDE[0]
        return (MOVED, SOME, MOVED[0]) if moved else (SHARES, HALVINGS, CLOSE)

    def _proved(
        self,
        rays: Rays,
        low: Fraction,
        design: Design | None,
        failed: _Failed | None,
        top: Fraction,
    ) -> tuple[Fraction, Design | None, _Failed | None]:
        """Return the largest factor that is proved, with its proof, and what fails first."""
        high = top if failed is None else failed.factor
        if failed is None and low < top:  # up to where the plant ends
            proof = self._proof(rays, top)
            if isinstance(proof, Design):
                return top, proof, None
            failed = proof
            high = top if failed is None else failed.factor
        shares, halvings, close = self._steps(low >= 1)
        for share in shares:
            factor = short(high * (1 - Fraction(share)), up=False)
            factor = Fraction(1) if factor < 1 < high else factor  # what is asked of others too
            if factor <= low:
                break
            proof = self._proof(rays, factor)
            if isinstance(proof, Design):
                low, design = factor, proof
                break
            high = factor
            if proof is not None:
                failed, high = proof, proof.factor
        for _ in range(halvings if low and (failed is not None or self._wide) else 0):
            if high - low <= close * high:
                break
            factor = short((low + high) / 2, up=False)
            proof = self._proof(rays, factor)
            if isinstance(proof, Design):
                low, design = factor, proof
                continue
            high = factor
            if proof is not None:
                failed, high = proof, proof.factor
        return low, design, failed

    def _soon(self, family: Family, count: int) -> Analysis | None:
        """Return the proof that few forms give, and few parts of the box: most boxes near the edge.

        Parameters
        ----------
        count : int
            Of parameters that grow: a box that is wide along one is divided sooner.
        """
        plant, law, parts = family.plant, family.law, self.region.parts
        if self._wide:
            return self._interpolated(family, count == len(self.growth.names))
        form = FORM_OF_ONE if count == 1 else FORM
        affordable = form in forms(plant, law, len(parts))
        if plant.moving or plant.remainder is not None or not affordable:
            return None
        if work_of(plant, law, form) > MOST_IN_PART:
            return None
        found = list[dict[str, Any]]()
        for part in parts:
            search = Search(plant, law, part, Deadline(None), len(parts), MOST_SOON, ENOUGH)
            evidence = evidence_at(plant, law, part, form, enough=ENOUGH) or search.in_parts()
            if evidence is None:
                return None
            found.append(evidence)
        return self._analysis(family, found)

    @cached_property
    def _wide(self) -> bool:
        """Whether the vertices are so many that no LMI of degree 1 is solved on the box."""
        plant, law = self.growth.plant, self.growth.law
        exact = not plant.moving and plant.remainder is None
        return exact and work_of(plant, law, FORM_OF_ONE) > MOST_WORK

    def _interpolated(self, family: Family, divided: bool) -> Analysis | None:
        """Return the proof by one Lyapunov matrix, or by one of each vertex.

        Parameters
        ----------
        divided : bool
            Whether a few parts of the box are tried too, which takes ten times as long.
        """
        plant, law, parts = family.plant, family.law, self.region.parts
        found = list[dict[str, Any]]()
        for part in parts:
            evidence = evidence_at(plant, law, part, LADDER[0])
            with suppress(np.linalg.LinAlgError):
                evidence = evidence or interpolated(plant, law, part)
            search = Search(plant, law, part, Deadline(None), len(parts), MOST_SOON, between=True)
            evidence = evidence or (search.in_parts() if divided else None)
            if evidence is None:
                return None
            found.append(evidence)
        return self._analysis(family, found)

    def _analysis(self, family: Family, found: Sequence[dict[str, Any]]) -> Analysis | None:
        """Return what evidence of the region's parts proves."""
        certificate = certificate_of(family.plant, family.law, self.region, found)
        verdict = certificate.prove()
        if not verdict.proved:
            return None
        return Analysis(
            family.plant, family.law, self.region, "proved", verdict.reason, certificate
        )

    def _proof(self, rays: Rays, factor: Fraction) -> Design | _Failed | None:
        """Return the proof at a factor, or a plant of that box that fails; None of neither."""
        with stage(f"proof at {float(factor):.7g}"):
            try:
                family = self.growth.at(rays.factors(factor))
                found = self._soon(family, len(rays.names))
                if found is None and self._wide:
                    return None
                found = found or analysed(family.plant, family.law, self.region, Deadline(None))
            except (InputError, FormatError):
                return None
            if found.alpha is not None:
                return self._failed_at(rays, family, factor, found.alpha)
            if found.certificate is None:
                return None
            bounds = list[Bound]()
            for limit in self.limits:
                bound = kept_bound(family.plant, family.law, limit)
                if bound is None:
                    return None
                bounds.append(bound)
            decay = proved_decay(family.plant, family.law, bounds)
            claims = [bound.claim for bound in bounds]
            design = Design(found.certificate, more=(*claims, *(() if decay is None else (decay,))))
            try:
                found.certificate.require_checkable(design.more)
            except NotProvedError:
                return None
            return design

    def _failed_at(
        self, rays: Rays, family: Family, factor: Fraction, alpha: Sequence[Fraction]
    ) -> _Failed | None:
        """Return what the search for a proof refuted, with the smallest box that holds it."""
        values = _values(family.plant, alpha)
        if values is None:
            return None
        least = Fraction(0)
        for name in rays.names:
            centre, half = centre_of(self.growth.parameter(name))
            least = max(least, abs(values[name] - centre) / half)
        _, what = pole_at(family.plant, family.law, self.region, alpha)
        return _Failed(min(factor, short(least, up=True)), values, what, True)

    def _confirmed(self, rays: Rays, lost: Lost) -> _Failed | None:
        """Return the plant that is lost in floats as one with rational values, a little beyond."""
        parameters = self.growth.plant.parameters
        shares = [Fraction(round(x * FINE), FINE) for x in lost.shares.tolist()]
        named = {p.name: share for p, share in zip(parameters, shares, strict=True)}
        inexact: _Failed | None = None
        for step in BEYOND:
            factor = short(Fraction(lost.factor * (1 + step)), up=True)
            factors = rays.factors(factor)
            with suppress(InputError):
                values = self.growth.values(factors, named)
                failed = self._fails(self.growth.at(factors), values, factor)
                if failed is not None and (failed.exact or not failed.decidable):
                    return failed
                inexact = inexact or failed
        return inexact

    def _fails(
        self, family: Family, values: dict[str, Fraction], factor: Fraction
    ) -> _Failed | None:
        """Return what is lost at values of the parameters, None where nothing is seen to be."""
        plant, law = family.plant, family.law
        alpha = joint([p.weights(values[p.name]) for p in plant.parameters])
        point = np.array([[float(a) for a in alpha]])
        if self._near_the_edge(family, point):
            blank = [placeholder(plant, law)] * len(self.region.parts)
            with suppress(FormatError):
                if refutes(certificate_of(plant, law, self.region, blank).claim(), alpha):
                    what = pole_at(plant, law, self.region, alpha)[1]
                    return _Failed(factor, values, what, True)
        for limit in self.limits:
            level = Fraction(limit.at_most or 0.0)
            if not exceeded(family, limit, point)[0]:
                continue
            said = f"{limit_text(limit)} is {'missed' if limit.is_margin else 'exceeded'}"
            if is_disk(limit):
                exact = broken(plant, law, limit, alpha, Fraction(repr(limit.limit))) is not None
                sure = exact or len(limit.names) == 1
                return _Failed(factor, values, said, exact, known_exactly(plant), sure)
            if isinstance(limit, SectorBound):
                exact = broken_elements(plant, law, limit, alpha, _factor(limit)) is not None
                return _Failed(factor, values, said, exact, known_exactly(plant), exact)
            square = attained(plant, law, replace(limit, at_most=None), alpha)
            exact = square is not None and square > level**2
            return _Failed(factor, values, said, exact, square is not None)
        return None

    def _near_the_edge(self, family: Family, alpha: Array) -> bool:
        """Whether a pole may not lie in the region, as far as floats tell."""
        with suppress(np.linalg.LinAlgError):
            poles = np.linalg.eigvals(loops_of(family.plant, family.law, alpha))
            return bool(self.region.distance(poles).max() > -1e-6 * self.region.size)
        return True


def _values(plant: UncertainPlant, alpha: Sequence[Fraction]) -> dict[str, Fraction] | None:
    """Return the parameters' values at alpha, exactly; None where none have this alpha."""
    if values_at(plant, alpha) is None:
        return None
    count, found = len(plant.parameters), dict[str, Fraction]()
    for k, p in enumerate(plant.parameters):
        bit = count - 1 - k
        upper = sum((a for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        low, high = p.scheduling(p.low), p.scheduling(p.high)
        found[p.name] = p.scheduling(low + upper * (high - low))
    return found


def _worst(family: Family, limit: Specification) -> Attained:
    """Return the worst case of a signal on the plant's own ranges."""
    plant, law, free = family.plant, family.law, replace(limit, at_most=None)
    alpha = seeded(plant, SAMPLES)
    try:
        values = family.values(free, alpha)
    except (InputError, np.linalg.LinAlgError):
        return Attained(limit, None, None, None, False)
    k = int(values.argmax())
    point, worst = alpha[k], float(values[k])
    if plant.parameters:
        point, worst = climbed(family, free, point, worst)
    sizes = plant.domain.sizes
    exact_point = exact_alpha(plant.domain.coordinates(point), sizes, _fine)
    bound, where = best_bound(plant, law, free), values_at(plant, exact_point)
    if is_disk(free):
        failure = broken(plant, law, free, exact_point)
        reached = worst if failure is None else inverse(failure.gain)
        size = None if failure is None else failure.gain
        return Attained(limit, bound, reached, where, failure is not None, failure, size=size)
    if isinstance(free, SectorBound):
        return _worst_elements(family, free, Attained(limit, bound, worst, where, False))
    square = attained(plant, law, free, exact_point)
    reached = worst if square is None else root_down(square)
    frequency = free.worst_frequency(plant, law, point)
    return Attained(limit, bound, reached, where, square is not None, frequency=frequency)


def _worst_elements(family: Family, free: SectorBound, found: Attained) -> Attained:
    """Return the worst case of elements with the plant, and numbers, for which it is refuted."""
    plant, law = family.plant, family.law
    alpha = seeded(plant, SAMPLES)
    try:
        factors, _ = free.linear(plant, law, alpha)
    except (InputError, np.linalg.LinAlgError):
        return found
    nearest = alpha[factors.argmin()]
    point = exact_alpha(plant.domain.coordinates(nearest), plant.domain.sizes, _fine)
    failure = broken_elements(plant, law, free, point)
    if failure is None:
        return found
    size, where = factor_of(failure, plant, free), values_at(plant, point)
    level = inverse(size) if size else np.inf
    return replace(found, attained=level, values=where, exact=True, failure=failure, size=size)


def _factor(limit: SectorBound) -> Fraction:
    return Fraction(repr(limit.limit))


def _claim(
    family: Family,
    region: Region,
    limits: Sequence[Specification],
    values: Mapping[str, Fraction],
) -> Failure | None:
    """Return the claim that a pole is not in the region at values, or not with errors of loops."""
    plant, law = family.plant, family.law
    alpha = joint([p.weights(values[p.name]) for p in plant.parameters])
    claim = decided(failure_at(plant, law, parts_of(region.document()), alpha))
    for limit in limits:
        if claim is None and is_disk(limit):
            claim = broken(plant, law, limit, alpha, Fraction(repr(limit.limit)))
        if claim is None and isinstance(limit, SectorBound):
            claim = broken_elements(plant, law, limit, alpha, _factor(limit))
    return claim


def _fine(value: float) -> Fraction:
    return Fraction(round(value * FINE), FINE)
