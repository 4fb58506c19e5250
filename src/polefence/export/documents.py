"""``guarantee.json``: what is proved of exported code; stated, written, and checked afresh.

Every sentence is made of what a file about the code holds: claims that are proved, or what was
sampled and is said to be. So `polefence check` writes the lines again, and compares.
"""

from __future__ import annotations

import hashlib
import math
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import DesignFileError, InputError
from polefence.base.explained import explained
from polefence.certify.certificate import Certificate, Check, plant_of
from polefence.certify.design import Design, check_document, read_document
from polefence.certify.measured import DUAL
from polefence.export.memory import kept
from polefence.export.observer import observer_sources
from polefence.export.program import (
    WORDS,
    Fixed,
    Memory,
    Polynomial,
    Program,
    Scheduled,
    Share,
    memory_of,
    number,
    with_anti_windup,
)
from polefence.export.sources import Texts, context, environment, sources
from polefence.export.timing import Timing, decay_in, milliseconds
from polefence.law.laws import PolynomialGain
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import states
from polefence.proof.claims.base import Claim
from polefence.proof.claims.observer import Observer as ObserverClaim
from polefence.proof.claims.rounding import (
    Code,
    Rounded,
    answer_errors,
    recovery_errors,
    rounding_error,
)
from polefence.proof.claims.sampled import Sampled
from polefence.proof.claims.samples import Samples
from polefence.proof.document import Document
from polefence.proof.fitted import Data
from polefence.proof.text import late_text, milliseconds_text, visible
from polefence.proof.work import FormatError
from polefence.region.regions import Region, region_of
from polefence.region.text import digits_down, digits_up, short_text
from polefence.search.observer import Observer

FILE_NAME = "guarantee.json"
BOARD = ("board", "start")  # endings of the names of what drives the law: see `with_board`
SAMPLED = "sampled.json"  # beside it, where there is a sample time: see `timing`

NO_BREAK = "\u00a0"
README = "README.md"


def guarantee_text(
    design: Design,
    claim: Rounded,
    texts: Texts,
    files: Mapping[str, bytes],
    seen: Seen | None = None,
    observer: tuple[Design, bool] | None = None,
) -> str:
    """Return the text of ``guarantee.json``.

    Parameters
    ----------
    design : Design
        The one that the claim about the gain is of.
    texts : Texts
        What, with the constants, the law's sources are made of.
    files : mapping
        What else runs; their digests are kept.
    seen : Seen, optional
        What was found of the sampled loop.
    observer : (Design, bool), optional
        The observer's design, and whether its code is given the plant's parameters.
    """
    claims: list[Claim] = [claim]
    export: dict[str, Any] = {"text": text_document(texts, seen)}
    if observer is not None:
        dual, export["by_parameters"] = observer
        claims.append(ObserverClaim(dual.certificate.claim(), dual.plant.inputs))
    export["files"] = {name: _digest(text) for name, text in files.items()}
    return replace(design.certificate.file(claims), export=export).dumps()


SLOW = (
    "From one update to the next each input moves by no more than its rate limit times the sample "
    "time, at first from 0. What is proved of that is the design's saturation, without rounding."
)


@explained
def check_guarantee(path: str | Path) -> Check:
    """Prove ``guarantee.json`` afresh, and that the sources beside it are those it is about.

    The law's sources are written again from the constants that the proof is about, and compared.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    """
    where = Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)
    document = read_document(where)
    answer, held = check_document(document, where), _held(where, document)
    if not answer.proved:
        return answer
    if held is not None:
        more = check_document(held, where.with_name(SAMPLED))
        reason = answer.reason if more.proved else f"{SAMPLED}: {more.reason}"
        both = {key: getattr(answer, key) + getattr(more, key) for key in ("claims", "verdicts")}
        answer = replace(more, reason=reason, **both)
        if not answer.proved:
            return answer
    try:
        changed = _other(where, document, held)
    except (FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error
    return replace(answer, answer="undecided", reason=changed) if changed else answer


def _observer(document: Document, claim: ObserverClaim | None) -> Observer | None:
    """Return the observer whose code is beside the law's."""
    if claim is None:
        return None
    design = Design(Certificate.of(replace(document, claims=(claim,))))
    return Observer(plant_of(document.plant), design)


def _held(path: Path, document: Document) -> Document | None:
    """Return the file about the sampled loop, where there is one; older ones have it in a claim."""
    text = (document.export or {}).get("text")
    asked = isinstance(text, dict) and "sampled" in text
    if not asked or document.first(Sampled) is not None:
        return None
    return read_document(path.with_name(SAMPLED))


def _loop(document: Document, held: Document | None, claim: Rounded, seen: Seen) -> Loop:
    """Return what is proved of the sampled loop of this code."""
    loop: Sampled | None = document.first(Sampled)
    if loop is not None:
        return Loop(float(loop.sample_time), loop.delay, float(loop.decay), seen)
    if held is None:
        raise InputError(f"{SAMPLED} is missing")
    try:
        samples, decay = decay_in(held, claim)
    except InputError as error:
        raise InputError(f"{SAMPLED}: {error}") from error
    return Loop(float(held.plant.step), samples.delay, decay, seen)


def _other(path: Path, document: Document, held: Document | None) -> str:
    """Return the fault of the first file that does not match the document, else ""."""
    claim: Rounded | None = document.first(Rounded)
    timed = held is not None or document.first(Sampled) is not None
    if claim is None or document.export is None:
        raise InputError("export: the description of the code is missing; export it again")
    observer = _observer(document, document.first(ObserverClaim))
    design, asked = claim.gain.subject.design, document.export
    if asked.keys() != {"text", "files"} | ({"by_parameters"} if observer else set()):
        raise InputError("export must hold text and files; by_parameters, with an observer")
    by_parameters = asked.get("by_parameters", False)
    if type(by_parameters) is not bool:
        raise InputError("export.by_parameters must be true or false")
    certificate = Certificate.of(replace(document, claims=(design,)))
    table, own_time = asked["text"], certificate.plant.sample_time
    # what is kept of the region in service may be another than the design's
    parts = [(part.kind, part.numbers) for part in design.region]
    samples = document.first(Samples)
    late = Fraction(0) if samples is None else samples.delay - samples.early
    facts = Facts(region_of(parts), claim, own_time, limited=False, observer=observer, late=late)
    if timed:
        seen = read_seen(table, observer is not None)
        facts = replace(facts, loop=_loop(document, held, claim, seen))
    program = rebuilt_program(claim.code, certificate)
    if certificate.law.anti_windup is not None:
        program = with_anti_windup(program, certificate.law)
        facts = replace(facts, recovering=True)
    memory = memory_of(program)
    if memory and not timed and own_time is None:
        raise InputError("claims: code with a memory needs a claim about its sampled loop")
    texts = rebuilt_texts(table, certificate, facts, memory.states if memory else 0)
    written = sources(program, texts)
    if observer is not None:
        written |= _observer_header(observer, program, texts, by_parameters)
    files = asked["files"]
    beside = {f"{texts.name}_observer.{end}" for end in "hc"} if observer else set()
    if not isinstance(files, dict) or (beside and not beside <= files.keys()):
        raise InputError("files must be a table of names and digests, the observer's among them")
    units = {f"{texts.name}_fmi{version}.fmu" for version in "23"}
    board = {f"{texts.name}_{file}.c" for file in BOARD}
    for name in files.keys() - beside - units - board:
        raise InputError(f"files: {str(name)[:100]!r} is not a file of this export")
    driven = board <= files.keys()
    readme = own_readme(program, texts, certificate, observer is not None, driven=driven)
    if (path.parent / README).exists():
        written |= {README: readme}
    digests = {name: _digest(text.encode()) for name, text in written.items()}
    for name, digest in {**files, **digests}.items():
        try:
            there = _digest((path.parent / name).read_bytes())
        except OSError:
            return f"{name} is missing beside it; keep the folder of an export together"
        if there != digest:
            return f"{name} is not what this version writes of what is proved; export it again"
    return ""


def _observer_header(
    observer: Observer, program: Program, texts: Texts, by_parameters: bool
) -> dict[str, str]:
    """Return the header that says what is proved of the observer, by its name."""
    given = observer.plant.parameters if by_parameters else ()
    sources = observer_sources(observer, program.number, texts, given, texts.sample_time)
    name = f"{texts.name}_observer.h"
    return {name: sources[name]}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def require_law(design: Design) -> None:
    """Refuse an observer's design: its gain is no law of the plant."""
    if design.certificate.observer or design.plant.name.endswith(DUAL):
        raise InputError(
            f"{design.plant.name}: the design of an observer, not of "
            "a law; export the state feedback's "
            "design and name this one as its observer (--observer)"
        )


def of_signals(design: Design) -> Design:
    """Return the design with its one gain restricted to the states that it uses.

    Its proof is the same: K C is the same matrix.
    """
    law, plant, certificate = design.law, design.plant, design.certificate
    if design.method != "lyapunov" or law.K is None:
        return design
    used = np.asarray(law.K.any(axis=0))
    used[len(used) - kept(design) :] = True
    if used.all() or not used.any():
        return design
    signals = [state for state, kept in zip(states(plant), used, strict=True) if kept]
    powers = (0,) * (len(plant.parameters) or len(plant.vertices))
    gain = PolynomialGain((powers,), law.K[None, :, used], tuple(signals), plant.parameters)
    if certificate.claim().sizes != gain.domain.sizes:
        return design
    evidence = {key: value for key, value in certificate.evidence.items() if key != "on"}
    return replace(design, certificate=replace(certificate, law=gain, evidence=evidence))


def names(
    design: Design | Certificate, own_states: int = 0
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of states and inputs, numbered where the plant has none.

    Of a law of measured signals, theirs in place of the states'. States that the code keeps itself,
    and their rates, are left out.
    """
    plant: UncertainPlant = design.plant
    n, m = plant.shape
    inputs = tuple(plant.inputs) or tuple(f"input {j + 1}" for j in range(m))
    if design.law.measured:
        labels = tuple(signal.label for signal in design.law.measured)
    else:
        labels = tuple(plant.states) or tuple(f"state {j + 1}" for j in range(n))
    return labels[: len(labels) - own_states], inputs[: m - own_states]


def rebuilt_program(code: Code, certificate: Certificate) -> Program:
    """Return the program that has these constants."""
    form = number(code.bits) if code.scales is None else WORDS[code.bits]
    law = certificate.law
    measured = bool(law.measured)
    held = code.memory
    memory = None
    if held is not None:
        own = None if code.G is None else _floats(code.G)
        memory = Memory(held.states, float(held.step), float(held.sample_time), own)
    if code.K is not None or law.K is not None:
        return Fixed(form, _floats(code.K), measured, memory, code.scales)
    pairs = zip(certificate.plant.parameters, code.shares, strict=False)
    shares = tuple(Share(p, float(s.low), float(s.high), float(s.scale)) for p, s in pairs)
    if law.W is None:
        gains = np.array([_floats(term) for term in code.terms])
        of_law = law.domain, law.powers
        return Polynomial(form, shares, *of_law, gains, measured, memory, code.scales)
    W, Z = (np.array([_floats(row) for row in table]) for table in (code.W, code.Z))
    L = None if code.L is None else _floats(code.L)
    return Scheduled(form, shares, law.domain, law.degree, _floats(code.T), W, Z, L, code.scales)


def text_document(texts: Texts, seen: Seen | None) -> dict[str, Any]:
    """Return what the sources say of themselves beside what is proved, as plain data."""
    table: dict[str, Any] = {"name": texts.name, "limits": list(texts.limits)}
    table |= {"rates": list(texts.rates)} if texts.rates else {}
    return table if seen is None else table | {"sampled": asdict(seen)}


def rebuilt_texts(table: Any, certificate: Certificate, facts: Facts, own_states: int = 0) -> Texts:
    """Return the texts of what is proved and sampled.

    Raises
    ------
    InputError
        If the table is not one that `text_document` wrote.
    """
    known = {"name", "limits"} | ({"sampled"} if facts.loop else set())
    if not isinstance(table, dict) or table.keys() - {"rates"} != known:
        raise InputError(f"text must hold {', '.join(sorted(known))}, and nothing else")
    name, limits, rates = table["name"], table["limits"], table.get("rates", [])
    if not isinstance(name, str) or not isinstance(limits, list) or not isinstance(rates, list):
        raise InputError("text: name must be text, limits and rates lists")
    if not all(_is_number(v) and 0 < v < 1e30 for v in (*limits, *rates)):
        raise InputError("text: limits and rates must be positive numbers")
    facts = replace(facts, limited=bool(limits or rates), slow=bool(rates))
    return Texts(
        name,
        certificate.plant.name,
        statement(facts, certificate.plant.data),
        *names(certificate, own_states),
        tuple(map(float, limits)),
        facts.period,
        facts.delay,
        tuple(map(float, rates)),
    )


def read_seen(table: Any, observed: bool) -> Seen:
    """Return the sampled findings of a file; the text about them says that they are no proof.

    Raises
    ------
    InputError
        If the table is not one that `text_document` wrote.
    """
    entry = table.get("sampled") if isinstance(table, dict) else None
    if not isinstance(entry, dict) or entry.keys() != {field.name for field in fields(Seen)}:
        raise InputError("text.sampled: what was sampled of the loop is missing, or more is there")
    pair = entry["observer"]
    beside = [0, 0.0] if pair is None else pair
    if not isinstance(beside, list) or len(beside) != 2 or (pair is not None) is not observed:
        raise InputError("text.sampled.observer must be two numbers, where there is an observer")
    counts, numbers = (
        (entry["points"], beside[0]),
        (entry["decay"], entry["region"], entry["stable"]),
    )
    if not all(type(count) is int and 0 <= count < 10**9 for count in counts) or not all(
        _is_number(v) and abs(v) < 1e30 for v in (*numbers, beside[1])
    ):
        raise InputError("text.sampled: points must be a whole number, others finite numbers")
    if type(entry["inside"]) is not bool:
        raise InputError("text.sampled.inside must be true or false")
    pair_seen = None if pair is None else (beside[0], float(beside[1]))
    decay, region, stable = map(float, numbers)
    return Seen(entry["points"], entry["inside"], decay, region, stable, pair_seen)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _floats(matrix: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([[float(value) for value in row] for row in matrix or []])


@dataclass(frozen=True)
class Seen:
    """Findings about the sampled loop at sampled parameters, and by trial: no proof.

    Attributes
    ----------
    points : int
        Parameter values.
    inside : bool
        Whether the poles lay in the region, as log(z) / Ts.
    decay : float
        The slowest [1/s].
    region, stable : float
        The longest sample times that left the poles there, and the loop stable [s].
    observer : (int, float) or None
        Parameter values and slowest decay of the loop that the observer closes.
    """

    points: int
    inside: bool
    decay: float
    region: float
    stable: float
    observer: tuple[int, float] | None = None


@dataclass(frozen=True)
class Loop:
    """The loop as a computer closes it: its decay rate, where one is proved, and what was seen."""

    sample_time: float
    delay: int
    decay: float | None
    seen: Seen
    reason: str = ""


@dataclass(frozen=True)
class Facts:
    """Facts that the lines are made of.

    Attributes
    ----------
    region : Region
    rounded : Rounded, optional
        What is proved of the code's rounding; None where nothing is, for the reason.
    sample_time : Fraction, optional
        The plant's own, in discrete time.
    limited : bool
        Whether the code cuts the inputs.
    late : Fraction
        By how many samples inputs act late in a plant that is samples of another.
    recovering : bool
        Whether what is cut off moves the law's own states.
    slow : bool
        Whether the code moves the inputs no faster than a rate.
    """

    region: Region
    rounded: Rounded | None
    sample_time: Fraction | None
    limited: bool
    loop: Loop | None = None
    observer: Observer | None = None
    reason: str = ""
    late: Fraction = Fraction(0)
    recovering: bool = False
    slow: bool = False

    @property
    def period(self) -> float | None:
        """From one update to the next [s], where that is known."""
        if self.loop is not None:
            return self.loop.sample_time
        return None if self.sample_time is None else float(self.sample_time)

    @property
    def delay(self) -> int:
        """From measuring to applying u, in samples: of the loop that was judged; rounded up."""
        return math.ceil(self.late) if self.loop is None else self.loop.delay


def loop_of(timed: Timing) -> Loop:
    """Return the proved and the sampled findings about the sampled loop."""
    sampled, beside = timed.sampling, timed.with_observer
    # a decay without bound [1/s]
    seen = Seen(
        sampled.points,
        sampled.inside,
        sampled.decay,
        timed.largest.region,
        timed.largest.stable,
        None if beside is None else (beside.points, min(beside.decay, 1e29)),
    )
    proof = timed.proof
    decay = proof.decay if proof.proved else None
    return Loop(sampled.sample_time, sampled.delay, decay, seen, proof.reason)


def statement(facts: Facts, data: Data | None = None) -> tuple[str, ...]:
    """Return what is guaranteed, proved or sampled, and what is not, of a plant from data say."""
    sentences = [_rounding(facts), *_timing(facts)]
    T = facts.sample_time
    if T is not None:
        late = f"acting {late_text(facts.late)}, as the plant has it"
        how = late if facts.late else "without delay"
        sentences.append(f"Run every {milliseconds_text(T)} ms, the plant's own, u {how}.")
    if facts.observer is not None:
        sentences += _of_observer(facts, facts.observer)
    sentences.append(_outside(facts))
    if facts.slow:
        sentences.append(SLOW)
    if facts.recovering:
        sentences.append(_anti_windup(facts))
    if data is not None:
        sentences.append(f"{data.note[:1].upper()}{visible(data.note[1:])}.")
    region = short_text(facts.region)
    return tuple(line for sentence in sentences for line in _wrapped(sentence, region))


def _wrapped(sentence: str, region: str) -> list[str]:
    """Break a sentence into lines, but not the region."""
    whole = sentence.replace(region, region.replace(" ", NO_BREAK))
    return [line.replace(NO_BREAK, " ") for line in textwrap.wrap(whole, 88)]


def _rounding(facts: Facts) -> str:
    region = short_text(facts.region)
    if facts.rounded is None:
        return f"NOT PROVED to keep the poles in {region}: {facts.reason}."
    share = rounding_error(facts.rounded) / facts.rounded.gain.error
    steps = " and its own states step" if facts.rounded.code.memory else ""
    return (
        f"Proved in exact arithmetic: all poles of A + B K lie in {region}, whatever the "
        f"parameters, with the gain as this code computes it{steps}; its rounding is at most "
        f"{digits_up(100 * share, 2)} % of what is proved to leave them there."
        + _absolute(facts.rounded)
    )


def _absolute(claim: Rounded) -> str:
    """Say what fixed-point code is off by whatever its signals are."""
    errors, memory = answer_errors(claim.code), claim.code.memory
    if not errors:
        return ""
    m = len(errors) - (memory.states if memory else 0)
    told = ", ".join(digits_up(error, 3) for error in errors[:m])
    steps = ", ".join(digits_up(error, 3) for error in errors[m:])
    step = f", and each step of its own states by at most {steps}" if steps else ""
    return (
        f" Besides, u is off by at most {told}, in the units of the inputs, whatever the signals "
        f"are{step}: an absolute error, which leaves poles where they are and does not die out."
    )


def _timing(facts: Facts) -> Iterator[str]:
    loop = facts.loop
    if loop is None:
        return
    seen, region = loop.seen, short_text(facts.region)
    late = ", u one step late" if loop.delay else ""
    time = f"Run every {milliseconds_text(Fraction(loop.sample_time))} ms{late}"
    if loop.decay is not None:
        rate = digits_down(loop.decay, 3)
        signals = facts.rounded is not None and facts.rounded.gain.subject.design.law.C
        given = "y" if signals else "x"
        yield f"{time}: with {given} measured the loop is proved to decay, at {rate} 1/s or faster."
    else:
        yield f"{time}: NOT PROVED to be stable: {loop.reason}."
    where, slowest = "in" if seen.inside else "NOT all in", digits_down(seen.decay, 3)
    yield (
        f"Sampled, not proved: at {seen.points} parameter values its poles, as log(z) / Ts, were "
        f"{where} {region}, the slowest decay {slowest} 1/s."
    )
    held, stable = (milliseconds(t) for t in (seen.region, seen.stable))
    yield f"By trial, not proved: the region holds up to {held}, stability up to {stable}."


def _of_observer(facts: Facts, observer: Observer) -> Iterator[str]:
    proved = "proved" if observer.design.proved else "NOT PROVED"
    time = "" if facts.sample_time is not None else "in continuous time and "
    yield (
        f"Observer: {proved} that the poles of its error lie in {short_text(observer.region)}, "
        f"{time}without rounding."
    )
    if facts.loop is not None and facts.loop.seen.observer is not None:
        points, decay = facts.loop.seen.observer
        how = f"decay {digits_down(decay, 3)} 1/s or faster" if decay > 0 else "are NOT stable"
        yield f"With it, sampled, not proved: the loops of {points} parameter values {how}."


def _outside(facts: Facts) -> str:
    sampled = facts.loop is not None or facts.sample_time is not None
    fixed = facts.rounded is not None and facts.rounded.code.scales is not None
    last = "saturation" if fixed else "underflow"
    missing = [last] if sampled else ["sampling", "delay", last]
    without = ", ".join(missing) + (" or limits" if facts.limited else "")
    return f"At constant parameters, without {without}."


def _anti_windup(facts: Facts) -> str:
    """Say what the code does while inputs are cut, and where what that leads to is proved."""
    time = "at the samples" if facts.sample_time is not None else "in continuous time"
    errors = [] if facts.rounded is None else recovery_errors(facts.rounded)
    told = ", ".join(digits_up(error, 3) for error in errors)
    told = f" Each step is off by at most {told} more then, and by G times the error of u."
    rounded = told if errors else ""
    return (
        "While an input is cut its code adds G (sat(u) - u) to the rates of the law's own states: "
        f"anti-windup, which is exactly zero while nothing is cut.{rounded} The limits with "
        f"which the loop then comes to rest are those of the design's saturation, proved {time} "
        "and without rounding."
    )


def own_readme(
    made: Program,
    texts: Texts,
    design: Design | Certificate,
    observed: bool,
    proved: bool = True,
    driven: bool = False,
) -> str:
    """Return the page's text."""
    facts = {
        "proved": proved,
        "discrete": design.plant.sample_time is not None,
        "bytes": local_bytes(made),
        "observer": observed,
        "board": driven,
    }
    template = environment().get_template("README.md.j2")
    return template.render(context(made, texts) | facts)


def local_bytes(made: Program) -> int:
    """Return the bytes of the arrays that an update keeps on the stack."""
    n, m = made.shape
    if made.scales is not None:
        # answers and weights in wide numbers, signals in words
        weights = 0 if isinstance(made, Fixed) else 2 * len(made.shares) + len(made.weights())
        solved = n * n + (m + 1) * n if isinstance(made, Scheduled) else 0
        return (2 * m + n + 2 * weights + solved) * made.number.bits // 8
    if memory_of(made):
        m += n
    if isinstance(made, Fixed):
        return m * made.number.bits // 8
    weights = len(made.shares) * 2 if made.shares else made.domain.corners
    count = weights + sum(made.domain.sizes) + m
    if isinstance(made, Scheduled):
        count += len(made.W) + (n + 1) * n + (n if made.L is not None else 0)
    else:
        count += len(made.gains) + len(made.powers[0])
    return count * made.number.bits // 8
