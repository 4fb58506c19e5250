"""Export of a design: a folder of C99, ours alone, written whole, with what is guaranteed of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, NotProvedError, OutputError
from polefence.base.explained import explained
from polefence.base.files import SHORT, begins_with, leftover, write_all
from polefence.certify.design import Design, check
from polefence.export.board import board_sources, require_drivable
from polefence.export.documents import (
    BOARD,
    FILE_NAME,
    README,
    SAMPLED,
    Facts,
    guarantee_text,
    loop_of,
    names,
    of_signals,
    own_readme,
    require_law,
    statement,
)
from polefence.export.fmu import compiler_path, fmu
from polefence.export.guarantee import Guarantee, guarantee, roundings
from polefence.export.held import Words
from polefence.export.memory import kept, with_rates
from polefence.export.observer import observer_sources
from polefence.export.program import (
    WORDS,
    Program,
    amid,
    code_law,
    number,
    program,
    scales_of,
    with_anti_windup,
    with_memory,
)
from polefence.export.sources import MARKER, Texts, check_c_name, sources
from polefence.export.timing import Timing, require_timing, timing
from polefence.export.vectors import harness, makefile
from polefence.export.word_vectors import word_harness
from polefence.law.control import GIVEN
from polefence.law.laws import Law
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import Claim
from polefence.proof.document import FORMAT
from polefence.proof.short import Short
from polefence.response.discrete import Sampling
from polefence.search.observer import Observer


@dataclass(frozen=True, eq=False)
class Exported(Short):
    """A law as code.

    Attributes
    ----------
    design : Design
    program : Program
        The numbers that the code has.
    texts : Texts
        What the code says of itself.
    guarantee : Guarantee
        What is proved of its rounding.
    timing : Timing, optional
        What was found of the loop at the sample time; None where none was given.
    observer : Observer, optional
    files : mapping of str to bytes
        The folder's contents.
    by_parameters : bool
        Whether the observer's code is given the parameters, not alpha.
    """

    design: Design
    program: Program
    texts: Texts
    guarantee: Guarantee
    timing: Timing | None = None
    observer: Observer | None = None
    files: dict[str, bytes] = field(repr=False, default_factory=dict)
    by_parameters: bool = False

    @property
    def proved(self) -> bool:
        """Whether the region is proved for the code; and, at a sample time, the loop stable."""
        return (
            self.design.proved
            and self.guarantee.proved
            and (self.timing is None or self.timing.proved)
            and (self.observer is None or self.observer.design.proved)
        )

    def save(self, directory: str | Path) -> list[Path]:
        """Write the folder, each file whole, and return the files' paths.

        Raises
        ------
        OutputError
            If it holds files of others, or cannot be written.
        """
        return write_folder(Path(directory), self.files, marks(self.texts.name))


@explained
def export_c99(
    design: Design,
    bits: int = 64,
    *,
    name: str = "law",
    given: str | None = None,
    limits: Sequence[float] | float = (),
    rates: Sequence[float] | float = (),
    sampling: Sampling | None = None,
    observer: Observer | None = None,
    allow_unproved: bool = False,
    fixed: int | None = None,
    ranges: Mapping[str, float] | None = None,
) -> Exported:
    """Return a law as C99 for a microprocessor, proved with the rounding of its own arithmetic.

    Parameters
    ----------
    design : Design
        Of a law of measured signals the code is given these; of one gain that leaves out states,
        where its proof is a Lyapunov polynomial, the others. It is proved here.
    bits : int
        32 or 64: the code computes in float or in double.
    name : str
        Begins the names of files and functions; a C identifier.
    given : str, optional
        "parameters" or "alpha": what the code is given; parameters where the plant has them.
    limits : float or sequence of float
        Largest absolute value of the inputs, one for all or one each; none without. What is proved
        is about the law within them.
    rates : float or sequence of float
        How fast the inputs may move, in their units/s, one for all or one each; none without. The
        code moves them from one update to the next by no more.
    sampling : Sampling, optional
        From one update to the next, and whether u is applied a sample late: the loop that a
        computer closes is then judged too. An observer needs it.
    observer : Observer, optional
        Of the same plant; its code is put beside that of the law.
    allow_unproved : bool
        Export even where the region is not proved for the code, or no decay rate of the sampled
        loop; the code and its folder then say so.
    fixed : int, optional
        16 or 32: the code computes in integers of so many bits, in place of floats.
    ranges : mapping, optional
        For ``fixed`` the largest absolute value of each signal, by its name, in its unit.

    Returns
    -------
    Exported
        Its `save` writes the folder.

    Raises
    ------
    NotProvedError
        If the design, the design with the code's rounding, or the stability of the sampled loop is
        not proved.
    InputError
        If an option cannot be used, or the law cannot be exported.
    """
    check_c_name(name)
    require_law(design)
    design = of_signals(with_rates(design)) if observer is None else design
    order = kept(design)
    cuts = _limits(limits, design.plant.shape[1] - order)
    slow = _limits(rates, design.plant.shape[1] - order, "rates", "input's unit/s")
    _require_anti_windup(design.law, cuts or slow)
    _require_observer(design, observer, sampling, allow_unproved)
    design.plant.require_on_time(
        "and code runs at samples",
        "design with --sample-time, which takes it in",
    )
    if sampling is not None:
        require_timing(design, sampling)
    period = _period(design, order, sampling)
    if fixed not in (None, *WORDS):
        raise InputError(f"fixed = {fixed!r} is not supported; use 16 or 32")
    if slow and (fixed is not None or not period):
        raise InputError(
            "rates: fixed-point code keeps to none; use --float"
            if fixed is not None
            else "rates: an input moves by so much in an update: give --sample-time too"
        )
    if fixed is None:
        if ranges:
            raise InputError("ranges of signals are for fixed-point code; give --fixed too")
        made = program(code_law(design.law), _scheduled_on(design, given), number(bits))
        made = with_memory(amid(made, code_law(design.law)), order, period)
        made = with_anti_windup(made, design.law) if cuts or slow else made
    else:
        if observer is not None:
            raise InputError("--fixed: an observer is exported in floats; use --float")
        words = Words(design, _scheduled_on(design, given), cuts, ranges or {}, order, period)
        made = words.program(fixed)
    answer = check(design)
    if not answer.proved and not allow_unproved:
        raise NotProvedError(f"not exported: the design is not proved: {answer.reason}")
    design = replace(design, proved=answer.proved)
    proof = guarantee(design, made)
    if not proof.proved and not allow_unproved:
        if fixed is not None:
            words.require_room(fixed, proof)
        raise NotProvedError(f"not exported: {proof.reason}")
    timed = None if sampling is None else timing(design, sampling, made, observer)
    if timed is not None and not timed.proved and not allow_unproved:
        raise NotProvedError(f"not exported: {timed.reason}")
    facts = _facts(design, proof, bool(cuts or slow), timed, observer)
    facts = replace(facts, recovering=design.law.anti_windup is not None, slow=bool(slow))
    texts = Texts(
        name,
        design.plant.name,
        statement(facts, design.plant.data),
        *names(design, order),
        cuts,
        facts.period,
        facts.delay,
        slow,
    )
    whole = Exported(design, made, texts, proof, timed, observer)
    files = _files(whole)
    if observer is not None:
        parameters = () if given == "alpha" else design.plant.parameters
        code = observer_sources(
            observer, made.number, texts, parameters, None if sampling is None else sampling.period
        )
        files |= {key: text.encode() for key, text in code.items()}
        whole = replace(whole, by_parameters=given != "alpha")
    return replace(whole, files=_sealed(whole, files))


def _require_anti_windup(law: Law, cuts: tuple[float, ...]) -> None:
    """Refuse code without the anti-windup that the law has."""
    if law.anti_windup is not None and not cuts:
        raise InputError(
            "limits: the law has anti-windup, so its code must know where the inputs end; give "
            "--limit U, in the input's unit (limits=U)"
        )


def _period(design: Design, order: int, sampling: Sampling | None) -> float:
    """Return the sample time [s]; a law with states of its own is stepped by it."""
    if design.plant.sample_time is not None:
        return float(design.plant.sample_time)
    if order and sampling is None:
        raise InputError(
            f"the law has {order} {'state' if order == 1 else 'states'} of its own, which its code "
            "updates at every sample: give the sample time in s, such as --sample-time 0.001 "
            "(sampling=Sampling(0.001))"
        )
    return 0.0 if sampling is None else sampling.period


def _facts(
    design: Design,
    proof: Guarantee,
    limited: bool,
    timed: Timing | None,
    observer: Observer | None,
) -> Facts:
    """Return the facts that the code may state about itself."""
    loop = None if timed is None else loop_of(timed)
    common = design.region, proof.claim, design.plant.sample_time, limited, loop, observer
    late = Fraction(0) if design.plant.sampling is None else design.plant.sampling.late
    if not design.proved:
        facts = Facts(*common, reason="the design itself is not proved", late=late)
        return replace(facts, rounded=None)
    return Facts(*common, reason=proof.reason, late=late)


def _require_observer(
    design: Design, observer: Observer | None, sampling: Sampling | None, allow_unproved: bool
) -> None:
    if observer is None:
        return
    observer.feedback(design)  # refuses another plant's
    if observer.plant.remainder is not None:
        raise InputError(
            "an observer at a sample time is not exported; leave out the observer, or design both "
            "in continuous time"
        )
    if design.law.measured:
        raise InputError("the law takes measured signals, not states; leave out the observer")
    if kept(design):
        raise InputError("the law has states of its own; leave out the observer")
    if sampling is None and design.plant.sample_time is None:
        raise InputError("an observer's code needs the sample time; give sampling (--sample-time)")
    if not observer.design.proved and not allow_unproved:
        raise NotProvedError("not exported: the observer's region is not proved")


@explained
def with_fmus(
    exported: Exported,
    versions: Sequence[str] = ("2.0", "3.0"),
    *,
    compiler: str = "cc",
    step: float | None = None,
) -> Exported:
    """Return an export with functional mock-up units of the same sources beside them.

    Parameters
    ----------
    versions : sequence of str
        Of FMI, "2.0" and "3.0".
    compiler : str
    step : float, optional
        The step that a simulator begins with [s]; the sample time, where there is one.

    Raises
    ------
    InputError
        If a version is unknown, the compiler fails, or there is an observer: a unit has the law.
    """
    require_fmus(compiler, exported.observer is not None)
    step = exported.texts.sample_time if step is None else step
    files = dict(exported.files)
    for version in versions:
        unit = fmu(exported.program, exported.texts, version=version, compiler=compiler, step=step)
        files[_fmu_name(exported.texts.name, version)] = unit
    return replace(exported, files=_sealed(exported, files))


def require_fmus(compiler: str, observed: bool) -> None:
    """Refuse FMUs of an export that has an observer, or without a compiler, before any work.

    Raises
    ------
    InputError
    """
    if observed:
        raise InputError("an FMU holds only the law; leave out the observer (--observer)")
    compiler_path(compiler)


@explained
def with_board(exported: Exported, claims: Sequence[Claim]) -> Exported:
    """Return an export with a program beside it that drives the law over random roads.

    It runs on this machine, and on a microprocessor in QEMU: see its Makefile.

    Parameters
    ----------
    claims : sequence of Claim
        What is proved of the design, such as those of `polefence.proof.document`; each bound on an
        rms, under the noise of the first, is printed beside what is measured.

    Raises
    ------
    InputError
        If no rms is bounded, the code has no sample time, or there is an observer.
    """
    timed = exported.texts.sample_time is not None
    require_drivable(claims, timed, exported.observer is not None)
    more = board_sources(exported.design, exported.program, exported.texts, claims)
    files = dict(exported.files) | {name: text.encode() for name, text in more.items()}
    files["Makefile"] = makefile(exported.texts, board=True).encode()
    page = own_readme(
        exported.program, exported.texts, exported.design, False, exported.proved, driven=True
    )
    return replace(exported, files=_sealed(exported, files | {README: page.encode()}))


def _fmu_name(name: str, version: str) -> str:
    return f"{name}_fmi{version[0]}.fmu"


def _sealed(exported: Exported, files: dict[str, bytes]) -> dict[str, bytes]:
    """Return the files with the digests of all code in ``guarantee.json``."""
    if not exported.proved or exported.guarantee.claim is None:
        return files
    name = exported.texts.name
    code_files = {f"{name}{ending}" for ending in (".c", ".h", "_test.c")}
    beside = {
        key: files[key]
        for key in sorted(files.keys() - code_files)
        if key.endswith((".c", ".h", ".fmu"))
    }
    seen = None if exported.timing is None else loop_of(exported.timing).seen
    observer = (
        None if exported.observer is None else (exported.observer.design, exported.by_parameters)
    )
    text = guarantee_text(
        exported.guarantee.design,
        exported.guarantee.claim,
        exported.texts,
        beside,
        seen,
        observer,
    )
    files = files | {FILE_NAME: text.encode()}
    if exported.timing is not None:
        files[SAMPLED] = exported.timing.proof.file().dumps().encode()
    return files


def marks(name: str) -> dict[str, bytes]:
    """Return the names of an export's files, and what marks each as one."""
    texts = [f"{name}{end}" for end in (".c", ".h", "_test.c", "_observer.c", "_observer.h")]
    texts += [*(f"{name}_{file}.c" for file in BOARD), f"{name}_start.ld", "Makefile", "README.md"]
    units = [_fmu_name(name, version) for version in ("2.0", "3.0")]
    text_marks = dict.fromkeys(texts, MARKER.encode()) | dict.fromkeys(
        (FILE_NAME, SAMPLED), FORMAT.encode()
    )
    return text_marks | dict.fromkeys(units, b"modelDescription.xml")


def _scheduled_on(design: Design, given: str | None) -> tuple[Parameter, ...]:
    if given not in (None, *GIVEN):
        raise InputError(f"given = {given!r} is unknown; use {' or '.join(GIVEN)}")
    if given == "parameters" and not design.plant.parameters:
        raise InputError("given = 'parameters': this plant was given by its vertices; use 'alpha'")
    if code_law(design.law).fixed or given == "alpha":
        return ()
    return design.plant.parameters


def _limits(
    limits: Any, inputs: int, name: str = "limits", unit: str = "input's unit"
) -> tuple[float, ...]:
    values = (limits,) * inputs if isinstance(limits, int | float) else tuple(limits)
    if values and len(values) != inputs:
        raise InputError(f"{name}: {len(values)} numbers for {inputs} inputs; one, or one each")
    for value in values:
        if not (isinstance(value, int | float) and 1e-30 < value < 1e30):
            raise InputError(
                f"{name}: {value!r} must be a number from 1e-30 to 1e30, in the {unit}"
            )
    return tuple(map(float, values))


def _files(exported: Exported) -> dict[str, bytes]:
    made, texts = exported.program, exported.texts
    bound = exported.guarantee.bound if exported.guarantee.proved else None
    files = {key: text.encode() for key, text in sources(made, texts).items()}
    law = code_law(exported.design.law)
    if scales_of(made) is None:
        test = harness(made, texts, law, bound)
    else:
        (rounding,) = roundings(exported.guarantee.design, made)
        test = word_harness(made, texts, law, rounding.blank)
    files[f"{texts.name}_test.c"] = test.encode()
    files["Makefile"] = makefile(texts, exported.observer is not None).encode()
    page = own_readme(made, texts, exported.design, exported.observer is not None, exported.proved)
    files[README] = page.encode()
    return files


def check_folder(directory: Path, marks: Mapping[str, bytes]) -> None:
    """Refuse a folder that holds files of others, before any work.

    Parameters
    ----------
    marks : mapping
        For each name that will be written, what such a file of ours has in its first bytes.

    Raises
    ------
    OutputError
        If it is no folder, or has a file of another name, or one of ours by name alone.
    """
    if not directory.exists():
        return
    if not directory.is_dir():
        raise OutputError(f"{directory}: is a file; name a folder")
    for entry in sorted(directory.iterdir()):
        # what the Makefile makes
        if entry.name == "build" and entry.is_dir():
            continue
        if not (_is_leftover(entry, marks) or _is_ours(entry, marks)):
            raise OutputError(
                f"{entry}: not a file of this export; nothing was written: name a folder that is "
                "empty, new, or an earlier export's of the same name"
            )


def _is_ours(entry: Path, marks: Mapping[str, bytes]) -> bool:
    known = entry.name in marks and not entry.is_symlink()
    return known and begins_with(entry, marks[entry.name])


def _is_leftover(entry: Path, marks: Mapping[str, bytes]) -> bool:
    """Whether an export that was killed left this behind."""
    name = leftover(entry.name)
    return name is not None and not entry.is_dir() and any(known[:SHORT] == name for known in marks)


def write_folder(
    directory: Path, files: Mapping[str, bytes], marks: Mapping[str, bytes]
) -> list[Path]:
    """Write files, all or none, and return their paths; an earlier export's others are removed.

    Raises
    ------
    OutputError
        If the folder holds files of others, or one cannot be written.
    """
    check_folder(directory, marks)
    if directory.exists():
        for entry in [
            leftover for leftover in directory.iterdir() if _is_leftover(leftover, marks)
        ]:
            entry.unlink(missing_ok=True)
    paths = write_all(directory, files)
    for name in marks.keys() - files.keys():
        (directory / name).unlink(missing_ok=True)
    return paths
