"""Trade-off curves: the least bound on one signal over a sweep of the limit on another, proved."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence, Set
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from polefence.base import VERSION, workers
from polefence.base.errors import InputError, PolefenceError, require_type
from polefence.base.explained import explained
from polefence.base.files import make_folder, read_text, write_text
from polefence.base.progress import stage
from polefence.base.renamed import warn_renamed
from polefence.certify.bounds import best_bound, bounds_file, sampled
from polefence.certify.certificate import Certificate
from polefence.certify.checks import (
    in_time_of,
    require_domain,
    require_moderate,
    require_movable,
    require_optimisable,
    require_region,
    stable_region,
)
from polefence.certify.decays import decay_claim
from polefence.certify.design import Design
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method, Scheduled, method_label, options
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof import reading, work
from polefence.proof.claims.base import prove
from polefence.proof.claims.decay import Decay
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.document import Document, from_plain
from polefence.proof.short import Short
from polefence.region.regions import Region
from polefence.region.text import digits_up
from polefence.requirements.named import by_name
from polefence.requirements.rms import Rms
from polefence.requirements.specification import Specification, claim_of
from polefence.search.limits import LABEL
from polefence.search.optimise import Optimised, method_for, optimise, structured
from polefence.search.rows import Row, Run, RunOptions, plant_summary
from polefence.search.task import Task

MAX_VALUES = 1000
TUNED = "tuned"  # the label of rows whose laws are
DECAY = "decay in any order"  # of periods of a clock that is not perfect: a rate [1/s]

SAMPLES = 2000  # points of the family that each law is looked at


@explained
def tradeoff(
    plant: UncertainPlant,
    minimise: Specification,
    over: Specification,
    values: Sequence[float],
    subject_to: Sequence[Specification] = (),
    region: Region | None = None,
    methods: Sequence[Method] | None = None,
    path: Path | None = None,
    structure: Structure | None = None,
    **options: Unpack[RunOptions],
) -> Front:
    """Return the least proved bound on one signal for every limit on another.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E.
    minimise, over : Specification
        What is to be small, and what is limited; limits of their own are left out of account.
    values : sequence of float
        Limits on ``over``, in its unit.
    subject_to : sequence of Specification
        Others to keep, each with its ``at_most``.
    region : Region, optional
        For the poles; stability by default.
    methods : sequence of Method, optional
        Those of `optimise`; by default "quadratic" and `Scheduled` of degree 1 and elevation 0.
    executor : concurrent.futures.Executor, optional
        Where to run; without one, here and one after the other.
    on_row : callable, optional
        Called with each row as it is finished, before laws of other limits are taken over.
    path : Path, optional
        A JSON file that is kept up to date after every row.
    structure : Structure, optional
        Its laws are tuned, in rows of the method "tuned"; there are no others.
    resume : bool
        Keep the proved rows that are in the file already.

    Returns
    -------
    Front
        A row that fails is "undecided", with the reason, and stops nothing.

    Raises
    ------
    InputError
        If what is asked does not fit the plant, or the file is of something else.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_moderate(plant)
    least, swept = (
        replace(_checked(specification, name), at_most=None)
        for specification, name in ((minimise, "minimise"), (over, "over"))
    )
    others = tuple(_checked(specification, "subject_to") for specification in subject_to)
    plant, asked_for = by_name(plant, (swept, *others, least))
    region = stable_region(plant) if region is None else in_time_of(plant, region)
    if structure is None and methods is None and any(one.beyond_lmi(plant) for one in asked_for):
        structure = Structure()
    asked = _asked(plant, asked_for, region, structure)
    named = _named(plant, methods, structure)
    limits = list(dict.fromkeys(float(value) for value in values))
    _require(asked, limits, list(named.values()))
    run = Run(path=path, **options)
    order = [(x, label) for x in limits for label in named]
    kept = run.path if run.resume else None
    done = {} if kept is None else finished(kept, asked, set(order))
    tasks = [(x, named[label]) for x, label in order if (x, label) not in done]
    computed = workers.as_finished(run.executor, partial(_row_of, asked), tasks)

    fresh = (((row["value"], row["method"]), row, row) for row in computed)
    run.complete(done, order, fresh, lambda path, rows: write_rows(path, asked, rows))
    done = monotone(done)
    run.keep(done, order, lambda path, rows: write_rows(path, asked, rows))
    return Front(asked, tuple(done[key] for key in order))


def _asked(
    plant: UncertainPlant,
    asked_for: tuple[Specification, ...],
    region: Region,
    structure: Structure | None,
) -> Asked:
    """Return the question, of the plant that laws of its answers are gains of."""
    require_region(plant, region)
    *limits, least = asked_for
    task = Task(plant, least, tuple(limits), region, "quadratic")
    if structure is not None:
        task, _ = structured(task, structure)
    swept, *others = task.limits
    bare, least = (plant, asked_for), task.minimise or least
    return Asked(task.plant, least, swept, tuple(others), region, structure, bare)


def _named(
    plant: UncertainPlant, methods: Sequence[Method] | None, structure: Structure | None
) -> dict[str, Method | None]:
    """Return methods by their labels; None is that of laws that are tuned."""
    if structure is not None:
        if methods is not None:
            raise InputError("methods and a structure exclude each other; leave one out")
        return {TUNED: None}
    if methods is None:
        methods = ("quadratic", Scheduled(1, 0, "box" if plant.parameters else "simplex"))
    return {method_label(method): method for method in methods}


def _checked(given: Any, name: str) -> Specification:
    require_type(given, Specification, name, "for example Rms('actuator force')")
    if name == "subject_to" and given.at_most is None:
        raise InputError(f"the limit of {given.name!r} is missing; give at_most")
    specification: Specification = given
    return specification


def _require(asked: Asked, values: list[float], methods: list[Method | None]) -> None:
    """Refuse, before any work, what no row could be computed for."""
    plant = asked.plant
    if not values or len(values) > MAX_VALUES or not methods:
        raise InputError(f"give 1 to {MAX_VALUES} values, and at least one method")
    for swept in (asked.minimise, asked.over):
        if swept.is_margin:
            raise InputError(
                f"{swept.title}: a margin is neither swept nor made as large as can be in a "
                "trade-off; give it a limit, and name signals"
            )
    for value in values:
        replace(asked.over, at_most=value)
    for method in methods:
        if method is None:
            continue
        require_domain(plant, method)
        o = options(method)
        if not isinstance(o, Scheduled) or o.degree == "auto" or o.right_hand_sides:
            raise InputError(
                "a trade-off takes the methods 'quadratic' and Scheduled(degree, elevation)"
            )
        require_optimisable(plant, method_for(plant, method), 2 + len(asked.subject_to))
    require_region(plant, asked.region)
    for specification in (asked.minimise, asked.over, *asked.subject_to):
        specification.require_fit(plant)
        beyond_lmi = specification.beyond_lmi(plant)
        if beyond_lmi and any(method is not None for method in methods):
            raise InputError(beyond_lmi)
        if specification.of_signal and not beyond_lmi:
            specification.condition(plant, plant.domain)
    if _same(asked.over, asked.minimise) or any(_same(asked.over, s) for s in asked.subject_to):
        raise InputError(
            f"{asked.over.kind} of {asked.over.name!r} is swept; minimise or limit something else"
        )
    require_movable(plant, asked.region)


def _same(one: Specification, other: Specification) -> bool:
    return replace(one, at_most=None) == replace(other, at_most=None)


def _row_of(asked: Asked, task: tuple[float, Method | None]) -> Row:
    """Return one row; whatever fails in it is its reason."""
    value, method = task
    label = TUNED if method is None else method_label(method)
    start = time.perf_counter()
    answer: Row
    try:
        plant, (over, *others, least) = asked.bare
        limits = (replace(over, at_most=value), *others)
        with stage(f"limit {value:g} {label}"):
            question = plant, least, limits, asked.region, method
            # rows are of one plant, that with all states of the law
            done = optimise(*question, structure=asked.structure, fewer_states=False)
            answer = _proved(asked, done, value)
    except PolefenceError as error:  # one row's failure is not the sweep's
        reason = " ".join(str(error).split()).removeprefix("not proved: ")
        nothing = dict.fromkeys(("proved", "sampled", "law_of", "own", "performance", DECAY))
        answer = {"answer": "undecided", **nothing, "bounds": [], "reason": reason}
    seconds = time.perf_counter() - start
    return {"value": value, "method": label} | answer | {"seconds": seconds}


def _proved(asked: Asked, done: Optimised, value: float) -> Row:
    first, over, *others = done.bounds
    # the law may keep less than its limit: then it will do for others
    least = best_bound(done.plant, done.law, over.specification)
    if least is not None and least.level < over.level:
        over = least
    claims, certificate = [bound.claim for bound in (first, over, *others)], done.design.certificate
    decay = () if done.decay is None else (done.decay,)
    certificate.require_checkable([*claims, *decay])
    return proved_row(asked, certificate, claims, value, done.decay)


@dataclass(frozen=True)
class Asked(Short):
    """Question of a trade-off.

    Attributes
    ----------
    plant : UncertainPlant
        With the law's own states.
    minimise, over : Specification
        Without limits.
    subject_to : tuple of Specification
    region : Region
    structure : Structure, optional
        Of laws that are tuned.
    bare : tuple of UncertainPlant and tuple of Specification
        The plant as it was given, and what was asked of it: over, the limits, minimise.
    """

    plant: UncertainPlant
    minimise: Specification
    over: Specification
    subject_to: tuple[Specification, ...]
    region: Region
    structure: Structure | None
    bare: tuple[UncertainPlant, tuple[Specification, ...]]

    def document(self) -> dict[str, Any]:
        """Return it as plain data, the plant by its digest."""
        law = (
            {}
            if self.structure is None
            else {"law": json.loads(json.dumps(asdict(self.structure)))}
        )
        return {
            "minimise": _as_read_from_json(self.minimise),
            "over": _as_read_from_json(self.over),
            "subject_to": [_as_read_from_json(specification) for specification in self.subject_to],
            "region": self.region.document(),
        } | law


def _as_read_from_json(specification: Specification) -> dict[str, Any]:
    # through JSON and back, so that it equals what is read from a file
    document: dict[str, Any] = json.loads(
        json.dumps({"kind": specification.kind} | asdict(specification), default=reading.plain)
    )
    if document["disturbances"] is None:  # all, as in files that do not say
        del document["disturbances"]
    return document


@dataclass(frozen=True, eq=False, repr=False)
class Front(Short):
    """Bounds that are reached at each limit, with their laws.

    Attributes
    ----------
    asked : Asked
        Plant, specifications and region.
    rows : tuple of dict
        One a value and method, as plain data: ``value``, the limit; ``method``, its label;
        ``answer``, "proved" or "undecided"; ``proved``, the bound on what is minimised, and
        ``sampled``, the same law's worst at sampled parameters; ``bounds``, of ``over`` and the
        other specifications, each with ``specification``, ``at_most``, ``proved``, ``sampled``;
        ``law_of``, the limit that the law was found for: another one's law is taken where it
        keeps this limit, and the search for this one found a worse one, or none; ``decay in any
        order``, the rate that is proved of a clock that is not perfect, else None; ``own``, what
        that search itself proved; ``performance``, the law with all of its proofs, as a
        performance file has them; ``reason``, where the search found nothing; ``seconds``.
    references : tuple of dict
        Of laws that come with no proof, see `polefence.vehicle.beside_reference_laws`: ``name``,
        the worst at sampled parameters of ``over`` and ``minimise``, and ``keeps``, whether that of
        the other specifications is within their limits.
    """

    asked: Asked
    rows: tuple[Row, ...]
    references: tuple[Row, ...] = ()

    def __repr__(self) -> str:
        done = sum(row["answer"] == "proved" for row in self.rows)
        return f"<Front of {self.asked.plant.name!r}: {done} of {len(self.rows)} rows proved>"

    @property
    def proved(self) -> bool:
        """Whether every row is."""
        return all(row["answer"] == "proved" for row in self.rows)

    @property
    def methods(self) -> tuple[str, ...]:
        """Labels, in the order asked for."""
        return tuple(dict.fromkeys(row["method"] for row in self.rows))

    @property
    def labels(self) -> tuple[str, str]:
        """Labels of axes: the limited and the minimised, with units."""
        over, least = (
            label_of(self.asked.plant, s) for s in (self.asked.over, self.asked.minimise)
        )
        return over, least

    def row(self, value: float, method: Method | str) -> Row:
        """Return the row of a limit and a method, or its label.

        Raises
        ------
        InputError
            If there is none.
        """
        label = method if method in self.methods else method_label(method)
        for row in self.rows:
            if row["value"] == value and row["method"] == label:
                return row
        raise InputError(f"no row of {label} at {value:g}")

    def design(self, value: float, method: Method | str) -> Design:
        """Return the law of a row with the proofs of its region and of its bounds.

        Raises
        ------
        InputError
            If there is no such row, or it is not proved.
        """
        file = self.file(value, method)
        return Design(Certificate.of(file), more=file.claims[1:])

    def save(self, value: float, method: Method | str, directory: str | Path) -> Path:
        """Save the design of a row: the old name of ``design(value, method).save(directory)``."""
        warn_renamed("Front.save", "Front.design(value, method).save(directory)")
        return self.design(value, method).save(directory)

    def file(self, value: float, method: Method | str) -> Document:
        """Return the file of a row: the law, its region and its bounds.

        Raises
        ------
        InputError
            If there is no such row, or it is not proved.
        """
        row = self.row(value, method)
        if row["performance"] is None:
            raise InputError(f"nothing is proved at {value:g}: {row['reason']}")
        return from_plain(row["performance"])

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the rows as plain values, for `pandas.DataFrame`: without laws and proofs.

        What each other specification is proved and sampled at are columns with its title.
        """
        plain = ("value", "method", "answer", "proved", "sampled", "law_of", "own", DECAY)
        rows = []
        for row in self.rows:
            cells = {key: row.get(key) for key in (*plain, "seconds", "reason")}
            for bound in row["bounds"]:
                title = bound["specification"]
                cells |= {f"{key} {title}": bound[key] for key in ("at_most", "proved", "sampled")}
            rows.append(cells)
        return rows

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        over, least = self.labels
        rows = (
            (f"{row['value']:g}, {row['method']}", _level(row["proved"], row["answer"]))
            for row in self.rows
        )
        return card(f"{least} for limits on {over}", rows)

    def document(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return head(self.asked) | {"references": list(self.references), "rows": list(self.rows)}


def _level(proved: float | None, answer: str) -> str:
    return answer if proved is None else f"<= {digits_up(proved)}"


def monotone(rows: dict[tuple[float, str], Row]) -> dict[tuple[float, str], Row]:
    """Return rows by value and method, each with the best law of its method that keeps its limit.

    What a law keeps is proved, so that a law of any other limit will do; those of tighter ones
    always keep a looser one.
    """
    eased = dict(rows)
    for (value, label), row in rows.items():
        laws = [
            r
            for (_, other), r in rows.items()
            if other == label and r["proved"] is not None and r["bounds"][0]["proved"] <= value
        ]
        best = min(laws, key=lambda r: float(r["proved"]), default=row)
        if best["proved"] is not None and best["proved"] < (row["proved"] or math.inf):
            first, *others = best["bounds"]
            keys = ("answer", "proved", "sampled", "law_of", "performance", DECAY)
            taken = {key: best[key] for key in keys}
            eased[value, label] = row | taken | {"bounds": [first | {"at_most": value}, *others]}
    return eased


def head(asked: Asked) -> dict[str, Any]:
    """Return what stands above the rows."""
    return {
        "polefence": VERSION,
        "plant": plant_summary(asked.plant),
        "question": asked.document(),
    }


def label_of(plant: UncertainPlant, specification: Specification) -> str:
    """Return kind, signal and unit of a specification."""
    unit = specification.unit(plant)
    return specification.title + (f" [{unit}]" if unit else "")


def write_rows(path: Path, asked: Asked, rows: Sequence[Row]) -> None:
    """Write a trade-off, whole or not at all."""
    document = head(asked) | {"references": [], "rows": list(rows)}
    make_folder(path.parent)
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def keep_references(path: Path, references: Sequence[Row]) -> None:
    """Add reference laws to a file of rows that `write_rows` wrote."""
    document = reading.parse(read_text(path, reading.MAX_BYTES, InputError))
    write_text(path, json.dumps(document | {"references": list(references)}, indent=1) + "\n")


def finished(
    path: Path, asked: Asked, wanted: Set[tuple[float, str]]
) -> dict[tuple[float, str], Row]:
    """Return the proved rows of an earlier run by value and method, all proved afresh.

    What a row says is taken from what was proved of it, and its law sampled again. Rows that are
    not ``wanted`` share one count of the work.

    Raises
    ------
    InputError
        If the file is unreadable, damaged, of another question, or by another version.
    """
    if not path.exists():
        return {}
    again = "remove the file to start anew, or name another one"
    try:
        document = reading.parse(read_text(path, reading.MAX_BYTES, InputError))
        heading = {key: document[key] for key in ("polefence", "plant", "question")}
        rows = {(row["value"], row["method"]): row for row in document["rows"]}
        same = heading == head(asked)
        # as much as any file may take for rows that nobody asked for
        most = work.MAX_FILE * (1 + len(rows.keys() & wanted))
        with work.counted(most):
            proved = {
                key: _reproved(row, asked) if same else None
                for key, row in rows.items()
                if row["answer"] == "proved"
            }
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: no trade-off to resume; {again}") from error
    if heading["polefence"] != VERSION:
        raise InputError(
            f"{path}: a trade-off by polefence {str(heading['polefence'])[:40]}; {again}"
        )
    if not same:
        raise InputError(f"{path}: a trade-off of another plant or other limits; {again}")
    sound = {key: row for key, row in proved.items() if row is not None}
    if len(sound) < len(proved):
        raise InputError(f"{path}: a row is damaged; {again}")
    return sound


def _reproved(row: Row, asked: Asked) -> Row | None:
    """Return what is proved of a row, None where that is not what it says."""
    numbers = (row["value"], row["proved"], row["law_of"], row["seconds"])
    real = all(isinstance(x, float | int) and math.isfinite(x) and x >= 0 for x in numbers)
    in_order = row["own"] is None or row["own"] >= row["proved"]
    tuned = asked.structure is not None
    if not (
        real and in_order and (row["method"] == TUNED if tuned else LABEL.fullmatch(row["method"]))
    ):
        return None
    document = from_plain(row["performance"])
    bounds = [claim for claim in document.claims if isinstance(claim, BoundClaim)]
    claims = [claim for claim in bounds if not isinstance(claim, Decay)]
    decay = document.first(Decay)
    certificate = of_plant(Certificate.of(document), asked.plant)
    fixed = certificate.law.K is not None
    if not _decays(row, asked, certificate, decay):
        return None
    limits = [None, row["value"], *(limit.at_most for limit in asked.subject_to)]
    levels = [row["proved"], *(bound["proved"] for bound in row["bounds"])]
    wanted = (asked.minimise, asked.over, *asked.subject_to)
    bounds_told = list(zip(wanted, levels, limits, strict=True))
    if not proves(asked.plant, asked.region, certificate, claims, bounds_told):
        return None
    if row["method"] == "quadratic" and not fixed:
        return None
    kept = {key: row[key] for key in ("value", "method")}
    seen = {key: row[key] for key in ("law_of", "own", "seconds")}
    return kept | proved_row(asked, certificate, claims, row["value"], decay) | seen


def of_plant(certificate: Certificate, plant: UncertainPlant) -> Certificate:
    """Return the claim as one about the plant asked for, of the same vertices."""
    law = certificate.law.of(plant.parameters)
    return replace(certificate, plant=plant, law=law) if _is_of(certificate, plant) else certificate


def _is_of(certificate: Certificate, plant: UncertainPlant) -> bool:
    return certificate.plant.digest == plant.digest


def proves(
    plant: UncertainPlant,
    region: Region,
    certificate: Certificate,
    claims: Sequence[BoundClaim],
    bounds: Sequence[tuple[Specification, float, float | None]],
) -> bool:
    """Prove the region and every bound of a row, as being about this plant and these signals.

    Parameters
    ----------
    bounds : sequence of tuple
        For each claim what is bounded, what the row says of it, and its limit if it has one.
    """
    if not _is_of(certificate, plant) or certificate.region != region:
        return False
    law = certificate.law.exact
    for claim, (specification, told, limit) in zip(claims, bounds, strict=True):
        on, evidence = claim.subject.on, claim.subject.evidence
        same = claim_of(plant, law, on, specification, evidence, claim.level)
        if limit is not None and claim.level > limit:
            return False
        if specification.read_as(float(claim.level)) != told or claim.bare != same.bare:
            return False
        if not prove(claim).proved:
            return False
    return certificate.prove().proved


def _decays(row: Row, asked: Asked, certificate: Certificate, decay: Decay | None) -> bool:
    """Prove the decay rate of a row, if it has one, as being of this plant and law."""
    if decay is None:
        return row[DECAY] is None
    bounded = next(
        (one for one in (asked.minimise, asked.over, *asked.subject_to) if isinstance(one, Rms)),
        None,
    )
    if bounded is None or not _is_of(certificate, asked.plant):
        return False
    evidence, rate = decay.subject.evidence, decay.level
    same = decay_claim(asked.plant, certificate.law, bounded, evidence, rate)
    return row[DECAY] == float(rate) and decay == same and prove(decay).proved


def proved_row(
    asked: Asked,
    certificate: Certificate,
    claims: Sequence[BoundClaim],
    value: float,
    decay: Decay | None = None,
) -> Row:
    """Return what a row says of a law: what is proved, and its worst at sampled parameters."""
    plant, law, alpha = asked.plant, certificate.law, seeded(asked.plant, SAMPLES)
    wanted = (asked.minimise, replace(asked.over, at_most=value), *asked.subject_to)
    levels = [float(claim.level) for claim in claims]
    worst = [worst_of(plant, law, specification, alpha) for specification in wanted]
    bounds = zip(wanted[1:], levels[1:], worst[1:], strict=True)
    return {
        "answer": "proved",
        "proved": levels[0],
        "sampled": worst[0],
        "bounds": [
            {
                "specification": specification.title,
                "at_most": specification.limit,
                "proved": specification.read_as(level),
                "sampled": None if seen is None else specification.read_as(seen),
            }
            for specification, level, seen in bounds
        ],
        "law_of": value,
        "own": levels[0],
        "reason": None,
        DECAY: None if decay is None else float(decay.level),
        "performance": bounds_file(certificate, [*claims, *([decay] if decay else [])]).write(),
    }


def worst_of(
    plant: UncertainPlant, law: Law, specification: Specification, alpha: Array
) -> float | None:
    """Return the worst sampled value; what is proved does not depend on there being one."""
    with suppress(InputError):
        return sampled(plant, law, specification, alpha).worst
    return None
