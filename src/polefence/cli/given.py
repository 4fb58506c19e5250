"""A plant, a law and limits that are given, as files or as words of the command line."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, shown
from polefence.base.files import read_text
from polefence.certify.certificate import Certificate, plant_of
from polefence.certify.design import FILE_NAME, OF_DAMPERS, read_document, require_kind
from polefence.cli.options import at_samples, note_sensors, region_of
from polefence.cli.subjects import claims_file, with_law_of
from polefence.law.arrays import compensator_from, law_from
from polefence.law.compensator import Compensator, has_text, written
from polefence.law.fields import is_fields
from polefence.law.laws import FixedGain, GainTable, Law, given_law, table_from
from polefence.law.structure import load_structure
from polefence.plant.arrays import NO_NAMES, Arrays, misfit, plant_from, read_arrays
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.plant.spec import load
from polefence.proof import reading, work
from polefence.proof.document import FORMAT
from polefence.proof.text import milliseconds_text
from polefence.region.regions import Disk, HalfPlane, Region
from polefence.requirements.asked import promised
from polefence.requirements.specification import Specification
from polefence.requirements.text import parse_names, parse_specification

OTHERS = (".mat", ".npz", ".npy", ".csv")  # files of other tools
WANTED = (
    'give a matrix, a design.json, a table {"grid": {name: knots}, "gains": nested lists}, or a '
    'compensator {"A": ..., "B": ..., "C": ..., "D": ...}'
)
Found = tuple[Compensator, tuple[str, ...]]  # with the names that a file has for it
NONE, SPEC = "none", "spec"  # of limits: the poles alone; all of a spec. Of a gain: u = 0


@dataclass(frozen=True)
class Given:
    """What is to be analysed.

    Attributes
    ----------
    plant : UncertainPlant
        As the law sees it: its samples, where the options ask for these.
    law : Law or GainTable
    arrays : Arrays or None
        The file of another tool that the plant is from; None of a spec.
    names : dict
        What that file calls things.
    compensator : str
        What is known of a law with states of its own, or of named signals; else empty.
    """

    plant: UncertainPlant
    law: Law | GainTable
    arrays: Arrays | None
    names: dict[str, str]
    compensator: str = ""

    def region(self, options: Any) -> Region:
        """Return the region of the options, else the spec's, else stability."""
        asked = options.region is not None or getattr(options, "disk", None) is not None
        region = region_of(options) if asked or self.arrays is None else None
        return region or (HalfPlane(0) if self.plant.sample_time is None else Disk(0, 1))

    def limits(self, asked: Sequence[str], options: Any) -> list[Specification]:
        """Return the limits that are asked for, or that the spec asks for; of a table none."""
        if [*asked] == [NONE] or ([*asked] == [SPEC] and isinstance(self.law, GainTable)):
            return []
        texts = [] if [*asked] == [SPEC] else [*asked]
        if self.arrays is not None:
            return [_limit(text) for text in texts]
        return list(promised(self.plant, options.spec, texts, "--limit"))

    def lyapunov(self, options: Any) -> list[Any]:
        """Return the Lyapunov matrices that come with the law, if any."""
        if options.lyapunov is not None:
            return read_arrays(options.lyapunov, self.names).only("P")
        return [] if self.arrays is None or "P" not in self.arrays else self.arrays["P"]

    def text(self, options: Any) -> list[str]:
        """Say what the law is, and which matrices of the file stand for what."""
        said = [self.compensator] if self.compensator else []
        if self.arrays is None:
            return said
        strange = misfit(self.arrays)
        names = [*"ABE", *("" if strange else "CDF"), "sample_time"]
        if options.gain is None:
            own = compensator_from(self.arrays, alone=False)
            names += [*own[1]] if own else ["K"] if "K" in self.arrays else ["Z", "W"]
        names += ["P"] if options.lyapunov is None else []
        sign = "; u = -K x" if options.minus and not said else ""
        out = self.arrays.left_out(names)
        rest = f"; not read, no numbers: {', '.join(out)}" if out else ""
        if "Ts" in self.arrays and "sample_time" not in self.arrays:
            rest += "; Ts is not read: --name sample_time=Ts if the plant is in discrete time"
        rest += f"; left out, no outputs: {strange}" if strange else ""
        listed = ", ".join(self.arrays.listed(names))
        return [*said, f"read: {listed} from {self.arrays.place}{sign}{rest}"]


def law_arguments(parser: argparse.ArgumentParser, names: Sequence[str] = ("--gain",)) -> None:
    """Declare PLANT and how its law is named, by an option of these names."""
    parser.add_argument(
        "spec",
        metavar="PLANT",
        help="a TOML spec, or a file with A and B, one each or one "
        "per vertex (.mat, .npz, .json, a "
        "folder of .csv)",
    )
    parser.add_argument(
        *names,
        dest="gain",
        metavar="WHAT",
        help="u = K x: '[[...]]', '[1 2; 3 4]', or a file: JSON with a matrix, a design, a table "
        "or a compensator; .mat, .npz, .npy or .csv with a K, or Ac, Bc, Cc, Dc; or u = K y: "
        "'(s + 50)/(s + 500)', rows of these, or of formulas in the parameters; none: u = 0; "
        "default: that of PLANT",
    )
    parser.add_argument(
        "--measured",
        metavar="NAMES",
        help="'A, B': what a gain or a compensator measures, in its order; default: the "
        "spec's [law], else all states or all outputs, whichever are as many",
    )
    parser.add_argument(
        "--minus",
        action="store_true",
        help="the law is u = -K x or -K y: negative feedback, as lqr, place and most tools have",
    )
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="NEW=OLD",
        help="the file calls it OLD what is called NEW here: --name P=Xopt; repeat for more",
    )


def lyapunov_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --lyapunov."""
    parser.add_argument(
        "--lyapunov",
        metavar="FILE",
        help="Lyapunov matrices P, one or one per vertex; default: the P of PLANT, if it has one",
    )


def read_given(options: Any) -> Given:
    """Read the plant and the law that the options name.

    Raises
    ------
    InputError
        If a file cannot be read, or the law does not fit the plant.
    """
    names = _names(options.name)
    plant, arrays = _plant(options.spec, names)
    seen = at_samples(plant, options)
    if arrays is None:
        seen = _with_own_states(seen, options)
        plant = plant if options.sample_time is not None else seen
    found = _given(seen, arrays, names, options)
    if found is not None:
        larger, law, said = _beside(plant, seen, found, options)
        return Given(larger, law, arrays, names, said)
    if seen is plant:
        law = _law(plant, arrays, names, options)
    else:
        law = _sampled_law(plant, seen, arrays, names, options)
    if options.measured is not None:
        raise InputError(
            "--measured is for a gain, or a compensator; a design, or a table of gains, is of what "
            "it was made for"
        )
    if options.minus:
        if isinstance(law, GainTable):
            raise InputError("--minus is for one gain or law; write the table with u = K x")
        if own_states(seen):
            raise InputError("--minus is for a law that others have given; a design has its sign")
        law = law.negated()
    return Given(seen, law, arrays, names)


def _given(
    plant: UncertainPlant, arrays: Arrays | None, names: dict[str, str], options: Any
) -> Found | None:
    """Return the compensator that the options name; None of any other law."""
    if options.gain == NONE:
        return None
    try:
        found = None
        if options.gain is not None:
            found = read_compensator(plant, options.gain, names)
        elif arrays is not None:
            found = compensator_from(arrays, alone=False)
            found = None if found is None else (found[0], ())  # the line of what is read has names
        if found is None and options.measured is not None:
            found = _gain_of_signals(arrays, names, options)
    except InputError as problem:
        raise type(problem)(_with_options(str(problem))) from problem
    return found


def _gain_of_signals(arrays: Arrays | None, names: dict[str, str], options: Any) -> Found | None:
    """Return a gain of what --measured names, one or one a vertex; None of another law."""
    if options.gain is not None:
        name, text = _read(options.gain, "--gain")
        if text is not None:
            K = _parsed(name, text)
            K = K["K"] if isinstance(K, dict) and [*K] == ["K"] else K
            return (Compensator(D=K), ()) if isinstance(K, list) else None
        arrays = read_arrays(name, names)
    if arrays is None or ("K" not in arrays and len(arrays.matrices) != 1):
        return None
    each = arrays.only("K")
    return Compensator(D=each[0] if len(each) == 1 else each), ()


def _beside(
    plant: UncertainPlant, seen: UncertainPlant, found: Found, options: Any
) -> tuple[UncertainPlant, Law | GainTable, str]:
    """Return the plant with the states of a compensator, its gain, and what it is in words."""
    given, read = found
    try:
        if given.measured is None:
            given = replace(given, measured=_measured(plant, given, options))
        elif options.measured is not None:
            raise InputError("names what it measures itself; leave out --measured")
        given = given.negated() if options.minus else given
        larger, law = given.beside(seen)
    except InputError as problem:
        where = options.spec if options.gain is None else _told(options.gain)
        text = _with_options(str(problem))
        raise type(problem)(text if text.startswith(where) else f"{where}: {text}") from problem
    if not given.order and given.measured is None:
        return larger, law, ""
    listed = ", ".join(y.label for y in given.signals(seen))
    table = "a table of " * isinstance(law, GainTable)
    what = f"{table}order {given.order}" if given.order else f"{table}gains"
    source = f"; {', '.join(read)} of {options.gain}" if read else ""
    return larger, law, f"law: {what}, u = {'-' * options.minus}K y of y = {listed}{source}"


def _measured(plant: UncertainPlant, given: Compensator, options: Any) -> tuple[str, ...] | None:
    """Return what a compensator measures by --measured, or by the spec's [law]; None of neither."""
    names = None if options.measured is None else parse_names(options.measured)
    if names is None and not _is_file_of_others(options.spec):
        structure = load_structure(options.spec)
        names = None if structure is None else structure.measured
        if names is not None and len(names) != given.width:
            names = None  # of another law
    if names is not None:
        note_sensors(plant, names, "the law")
        return tuple(names)
    if not given.order and given.width == plant.shape[0]:
        return None
    # outputs of a spec are more often limited than measured
    bare = plant if _is_file_of_others(options.spec) else replace(plant, outputs=())
    return tuple(y.name for y in given.signals(bare))


def _with_options(text: str) -> str:
    """Return a message of the Python interface with the options that do the same."""
    text = text.replace("measured=['A', 'B']", "--measured 'A, B'")
    return text.replace("polefence.at_sample_time", "--sample-time")


def _told(what: str) -> str:
    return "--gain" if is_written(what) else what


def _with_own_states(plant: UncertainPlant, options: Any) -> UncertainPlant:
    """Return the plant with the states of the law that a design has for it, of the same time."""
    if options.gain is None or is_written(options.gain):
        return plant
    path = claims_file(Path(options.gain))
    if path is None:
        return plant
    claimed = plant_of(read_document(path).plant)
    if claimed.sample_time == plant.sample_time:
        return with_law_of(plant, claimed, options.spec)
    if own_states(claimed) and claimed.sample_time is not None:
        raise InputError(
            f"{path}: its law has states of its own, which move every "
            f"{milliseconds_text(claimed.sample_time)} ms; give --sample-time "
            f"{float(claimed.sample_time):g}, and its --delay"
        )
    if own_states(claimed):
        raise InputError(
            f"{path}: its law has states of its own, in continuous time; leave out --sample-time, "
            "or design it with it: polefence optimise --sample-time"
        )
    return plant


def _plant(what: str, names: dict[str, str]) -> tuple[UncertainPlant, Arrays | None]:
    path = Path(what)
    if claims_file(path) is not None:
        raise InputError(f"{path}: a file of claims; polefence check proves it afresh")
    if _is_file_of_others(what):
        arrays = read_arrays(what, names)
        return plant_from(arrays), arrays
    return load(path), None


def _is_file_of_others(what: str) -> bool:
    path = Path(what)
    return path.is_dir() or path.suffix.lower() in (*OTHERS, ".json")


def _law(
    plant: UncertainPlant, arrays: Arrays | None, names: dict[str, str], options: Any
) -> Law | GainTable:
    if options.gain == NONE:
        n, m = plant.shape
        return given_law(plant, [[0] * n] * m)
    if options.gain is not None:
        return read_gain(plant, options.gain, names)
    if arrays is None:
        raise InputError(
            f"{options.spec}: a spec has no gain; name one by --gain, or none by --gain none"
        )
    return law_from(arrays, plant)


def _sampled_law(
    plant: UncertainPlant,
    seen: UncertainPlant,
    arrays: Arrays | None,
    names: dict[str, str],
    options: Any,
) -> Law:
    """Return the law of a computer's samples.

    A gain of the plant is zero of inputs that are on their way; one of a design at a sample time
    has them.
    """
    try:
        law = _law(seen, arrays, names, options)
    except InputError:  # of the plant, not of what is on its way
        law = _law(plant, arrays, names, options)
        if isinstance(law, FixedGain):
            return law.with_states(seen.shape[0] - plant.shape[0])
    else:
        if not isinstance(law, GainTable):
            return law
    raise InputError(
        "--sample-time judges one gain, and laws that are designed so; of any other "
        "`polefence export --sample-time` says how fast the loop decays"
    )


def _names(given: Sequence[str]) -> dict[str, str]:
    names = dict[str, str]()
    for text in given:
        new, sign, old = text.partition("=")
        if not (new and sign and old):
            raise InputError(f"--name {shown(text)} is not of the form NEW=OLD; write P=Xopt")
        names[new] = old
    return names


def _limit(text: str) -> Specification:
    try:
        return parse_specification(text)
    except InputError as error:
        raise InputError(f"--limit {shown(text)}: {error}") from error


def read_gain(
    plant: UncertainPlant, what: str, names: Mapping[str, str] = NO_NAMES, option: str = "--gain"
) -> Law | GainTable:
    """Read a gain: JSON text, or a file with a matrix, a design or a table; never executed.

    Parameters
    ----------
    names : mapping
        What a file of another tool calls K, Z or W.
    option : str
        What says it, for messages.

    Raises
    ------
    InputError
        If it cannot be read, or does not fit the plant; the file is named.
    """
    found = read_compensator(plant, what, names, option)
    if found is not None:
        given, name = found[0], option if is_written(what) else what
        if given.order:
            raise InputError(
                f"{name}: a law with states of its own; prove it by polefence verify --gain, with "
                "-o DIR, and give DIR here"
            )
        try:
            return given.beside(plant)[1]
        except InputError as error:
            raise type(error)(f"{name}: {error}") from error
    name, text = _read(what, option)
    if text is None:
        return law_from(read_arrays(name, names), plant, alone=True)
    data = _parsed(name, text)
    try:
        if isinstance(data, dict) and data.get("format") == FORMAT:
            certificate = Certificate.loads(text)
            require_kind(certificate)
            return given_law(plant, certificate.law)
        if isinstance(data, dict) and "grid" not in data and {"K", "W", *names} & data.keys():
            return law_from(read_arrays(name, names), plant, alone=True)
        if isinstance(data, dict) and "format" in data:
            raise InputError(f"format = {shown(data['format'])} is not read here; {WANTED}")
        if isinstance(data, dict):
            return table_from(plant.parameters, data)
        return given_law(plant, data)
    except InputError as error:
        raise type(error)(f"{name}: {error}") from error


def read_compensator(
    plant: UncertainPlant, what: str, names: Mapping[str, str] = NO_NAMES, option: str = "--gain"
) -> Found | None:
    """Read a law with states, or with texts in it, as `read_gain` does; None of any other law.

    The names are those of a file with several arrays.

    Raises
    ------
    InputError
        If it cannot be read; the file is named.
    """
    if _is_transfer(what):
        try:
            return written(plant, what), ()
        except InputError as error:
            raise type(error)(f"{option}: {error}") from error
    name, text = _read(what, option)
    if text is None:
        return compensator_from(read_arrays(name, names), alone=True)
    data = _parsed(name, text)
    own = names.get("K", "K")
    if isinstance(data, dict) and isinstance(data.get(own), dict):
        data = data[own]
    try:
        if isinstance(data, dict) and "format" not in data and is_fields(data):
            return Compensator.from_fields(data), ()
        return (written(plant, data), ()) if has_text(data) else None
    except InputError as error:
        raise type(error)(f"{name}: {error}") from error


def _read(what: str, option: str) -> tuple[str, str | None]:
    """Return where a law is from, and its text; None of a file that `read_arrays` reads."""
    if is_written(what):
        if len(what) > 100_000:
            raise InputError(f"{option} has {len(what)} characters; write a file")
        return option, what
    path = Path(what)
    inside = (path / name for name in (FILE_NAME, OF_DAMPERS))
    path = next((own for own in inside if own.is_file()), path)
    if path.is_dir() or path.suffix.lower() in OTHERS:
        return str(path), None
    return str(path), read_text(path, reading.MAX_BYTES, InputError)


def _parsed(name: str, text: str) -> Any:
    try:
        return reading.parse(_as_json(text))
    except work.FormatError as error:
        raise InputError(f"{name}: {error}") from error


def _is_transfer(what: str) -> bool:
    """Whether a word is a transfer function, as "(s + 50)/(s + 500)"; no file has its name."""
    formula = re.fullmatch(r"[-+*/().^0-9eE\s]*[sz][-+*/().^0-9eEsz\s]*", what)
    return formula is not None and not Path(what).exists()


def _as_json(text: str) -> str:
    """Return a matrix as commands print it, ``[1 2; 3 4]``, as JSON; any other text as it is.

    Texts may be in single quotes, as shells and Python have them.
    """
    if '"' not in text:
        text = text.replace("'", '"')
    matrix = re.fullmatch(r"\[([-+.0-9eE\s,;]+)\]", text.strip())
    if matrix is None:
        return text
    rows = (re.split(r"[\s,]+", row.strip(" ,\t\r\n")) for row in matrix[1].split(";"))
    return "[" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]"


def is_written(what: str) -> bool:
    """Whether a word of the command line is a law itself, not a file's name."""
    return what.lstrip().startswith(("[", "{")) or _is_transfer(what)
