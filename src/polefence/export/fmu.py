"""A law as a functional mock-up unit: FMI 2.0 or 3.0, co-simulation, from the exported sources.

Variables have names that every importer takes, units, starts and descriptions.

Source: Functional Mock-up Interface, versions 2.0 and 3.0, fmi-standard.org.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import re
import shutil
import subprocess
import uuid
import zipfile
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from polefence.base.errors import InputError
from polefence.export import sources as c99
from polefence.export.program import Fixed, Program, memory_of, scales_of
from polefence.export.sources import Texts
from polefence.proof.short import Short

if TYPE_CHECKING:
    from jinja2 import Environment

VERSIONS = ("2.0", "3.0")
# "suspension deflection [m]", where the unit is no more than letters, digits and signs
UNIT = re.compile(r"(.*?)\s*\[([A-Za-z0-9 ./*^()%°µμΩ·²³-]{1,30})\]\s*", re.DOTALL)

# gcc turns contraction off by -std=c99 already, clang does not. -O1: an update takes a microsecond,
# and most of the code is asked for once.
FLAGS = ("-std=c99", "-O1", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-shared")
TIMEOUT = 120  # [s] of a compiler
# Words of a compiler's target, the system in FMI 3.0 and FMI 2.0, the ending of its libraries.
SYSTEMS = (
    (("darwin", "macos"), "darwin", "darwin", "dylib"),
    (("mingw", "windows", "cygwin"), "windows", "win", "dll"),
    (("linux",), "linux", "linux", "so"),
)
MACHINES = (
    ("x86_64|amd64", "x86_64"),
    ("i[3-6]86|x86", "x86"),
    ("aarch64|arm64", "aarch64"),
    ("arm.*", "aarch32"),
    ("riscv64", "riscv64"),
)


def fmu(
    program: Program,
    texts: Texts,
    *,
    version: str,
    compiler: str = "cc",
    step: float | None = None,
) -> bytes:
    """Return an FMU of co-simulation, with sources and the library that the compiler makes of them.

    Inputs are the states x, then the parameters or weights that the program is given; outputs are u
    and the flags. All real variables are doubles, whatever the law computes with: what code in
    fixed point is given is rounded to its integers, and cut to their range. u is always that of the
    inputs as they are now, also before the first step. States of the law's own begin at 0, or where
    parameters say what acts before them, where that is answered first; and a step, of whole sample
    times, takes them further. The same program, texts and compiler give the same bytes.

    Parameters
    ----------
    version : "2.0" or "3.0"
        Of FMI.
    compiler : str
        A C compiler that takes the options of gcc.
    step : float, optional
        Step [s] that importers take unless told otherwise.

    Raises
    ------
    InputError
        If version or step cannot be used, the compiler is missing, fails, or builds for a system
        that FMI does not know.
    """
    if version not in VERSIONS:
        raise InputError(f"FMI version = {version!r} is unknown; use {' or '.join(VERSIONS)}")
    if step is not None and not (math.isfinite(step) and step > 0):
        raise InputError(f"step = {step!r} s; give a number above zero")
    description, sources = _texts(program, texts, version, step)
    place, binary = library(sources, texts.name, version, compiler)
    files: dict[str, bytes] = {"modelDescription.xml": description.encode()}
    files |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    return _zipped(files | {place: binary})


def _texts(
    program: Program, texts: Texts, version: str, step: float | None
) -> tuple[str, dict[str, str]]:
    """Return the model description and the sources, which know a digest of both."""
    law, common = c99.sources(program, texts), c99.context(program, texts)
    fmi = f"fmi{version[0]}"
    given = common | variables(program, texts, common)
    given |= {
        "ports": _ports(program),
        "title": plain(texts.title) or texts.name,
        "description": plain(" ".join(texts.statement)),
        "step": "" if step is None else repr(float(step)),
        "period": repr(texts.sample_time),
        "c_files": [f"{texts.name}.c", f"{texts.name}_{fmi}.c"],
        "fmi": fmi,
        "handle": "fmi2Component" if fmi == "fmi2" else "fmi3Instance",
        "flags_type": "fmi2Integer" if fmi == "fmi2" else "fmi3UInt32",
    }
    code = c99.environment()
    pages = code.overlay(autoescape=True)
    unsigned = _rendered(code, pages, given | {"token": "", "design": "0U"})
    digest = hashlib.sha256()
    for text in (version, *law.values(), *unsigned.values()):
        digest.update(hashlib.sha256(text.encode()).digest())
    raw = digest.digest()
    signature = {
        "token": f"{{{uuid.UUID(bytes=raw[:16])}}}",
        "design": f"{int.from_bytes(raw[16:20], 'big')}U",
    }
    rendered = _rendered(code, pages, given | signature)
    return rendered.pop("modelDescription.xml"), law | rendered


def _rendered(code: Environment, pages: Environment, given: dict[str, Any]) -> dict[str, str]:
    """Return the texts; pages are of XML, and escape what they are given."""
    fmi, name = given["fmi"], given["name"]
    texts = {
        "modelDescription.xml": pages.get_template(f"{fmi}.xml.j2").render(given),
        f"{name}_{fmi}.h": code.get_template(f"{fmi}.h.j2").render(given),
        f"{name}_{fmi}.c": code.get_template(f"{fmi}.c.j2").render(given),
    }
    if fmi == "fmi3":
        texts["buildDescription.xml"] = pages.get_template("fmi3.build.xml.j2").render(given)
    return texts


def _zipped(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            # the first time that a zip file can say
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            info.create_system = 3  # or it would tell where it was made
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return buffer.getvalue()


@dataclass(frozen=True)
class Variable(Short):
    """A variable of the model description.

    Attributes
    ----------
    name : str
        Letters, digits and _, unique.
    reference : int
        Value reference.
    description, unit, start : str
        Empty for none.
    """

    name: str
    reference: int
    description: str
    unit: str = ""
    start: str = ""


def variables(program: Program, texts: Texts, common: dict[str, Any]) -> dict[str, Any]:
    """Return what the templates are told of variables.

    Value references count from 1: x, what the program is given, u, the flags.

    Parameters
    ----------
    common : dict
        `c99.context` of the two.
    """
    shares = () if isinstance(program, Fixed) else program.shares
    middles = [float((s.parameter.low + s.parameter.high) / 2) for s in shares]
    given = common["given"]
    starts = [0.0] * len(texts.states) + (middles or [1 / len(given) for _ in given])
    named = [split(text) for text in texts.states]
    named += [(s.parameter.name, plain(s.parameter.unit)) for s in shares] or [
        (f"alpha_{j + 1}", "") for j in range(len(given))
    ]
    named += [split(text) for text in texts.inputs]
    fallbacks = [f"{common['vector']}{i + 1}" for i in range(len(texts.states))]
    fallbacks += [f"{common['letter']}{j + 1}" for j in range(len(given))]
    fallbacks += [f"u{i + 1}" for i in range(len(texts.inputs))]
    names = unique([name for name, _ in named], fallbacks, ("time", "flags"))
    described = [plain(text) for text in (*texts.states, *given, *texts.inputs)]
    begins = [repr(start) for start in starts] + [""] * len(texts.inputs)
    listed = [
        Variable(name, k + 1, description, unit, start)
        for k, (name, description, (_, unit), start) in enumerate(
            zip(names, described, named, begins, strict=True)
        )
    ]
    return {
        "inputs": listed[: len(starts)],
        "outputs": listed[len(starts) :],
        "flags": Variable("flags", len(listed) + 1, _flags(common)),
        "beginning": _beginning(listed[len(starts) :], names) if common["order"] else [],
        "units": sorted({v.unit for v in listed if v.unit}),
        "starts": begins[: len(starts)],
    }


def _beginning(outputs: list[Variable], taken: list[str]) -> list[Variable]:
    """Return parameters of the law's own states' begin, behind the flags."""
    named = [f"acting_{each.name}" for each in outputs] + ["begins_with_acting"]
    words = unique(named, named, ("time", "flags", *(name.lower() for name in taken)))
    first = outputs[-1].reference + 2
    told = [f"{each.description}, before the law takes over" for each in outputs]
    told.append("1: its states begin where its first answer is what acts before; 0: at 0")
    units = [each.unit for each in outputs] + [""]
    return [
        Variable(name, first + k, text, unit, "0.0")
        for k, (name, text, unit) in enumerate(zip(words, told, units, strict=True))
    ]


def _ports(program: Program) -> dict[str, list[str]]:
    """Return the powers of two that make integers of what comes in, and values of what goes out."""
    scales, memory = scales_of(program), memory_of(program)
    if scales is None:
        return {}
    own, given = memory.states if memory else 0, list(scales.given)
    if not (isinstance(program, Fixed) or program.shares):
        given = [program.number.bits - 2] * program.domain.corners
    signals, answers = (
        list(values[: len(values) - own]) for values in (scales.signals, scales.answers)
    )
    return {
        "entering": [f"0x1p{s}" for s in signals + given],
        "leaving": [f"0x1p{-t}" for t in answers],
    }


def _flags(common: dict[str, Any]) -> str:
    meanings = [(1, common.get("clamped")), (2, common.get("not_a_number"))]
    if common["fixed"]:
        if common["by_parameters"]:
            meanings.pop()
        meanings += [(4, "an input of the unit was no number: 0 was taken")]
        meanings += [(8, "u was cut to its limit, or to the largest that the code can say")]
        meanings += [(16, "a state of the law was cut to its range" if common["order"] else None)]
        meanings += [(32, "an input of the unit was cut to the range that the code can say")]
        return "Sum of " + "; ".join(f"{bit} {text}" for bit, text in meanings if text)
    meanings += [(4, f"{common['vector']} not finite, or too large to compute with: u is 0")]
    meanings += [(8, "u was cut to its limit" if common["limits"] else None)]
    meanings += [(16, "the law's own states begin again at 0" if common["order"] else None)]
    meanings += [(32, "u moved as fast as it may" if common["steps"] else None)]
    return "Sum of " + "; ".join(f"{bit} {text}" for bit, text in meanings if text)


def split(text: str) -> tuple[str, str]:
    """Return name and unit of "suspension deflection [m]"; "" where FMI cannot define the unit."""
    match = UNIT.fullmatch(text)
    return (match[1], match[2].strip()) if match and match[2].strip() else (text, "")


def unique(names: list[str], fallbacks: list[str], taken: tuple[str, ...]) -> list[str]:
    """Return identifiers that importers accept unchanged, distinct regardless of case."""
    used, words = set(taken), list[str]()
    for name, fallback in zip(names, fallbacks, strict=True):
        word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:60] or fallback
        base = word if word[0].isalpha() else f"{fallback}_{word}"
        word, count = base, 1
        while word.lower() in used:
            count += 1
            word = f"{base}_{count}"
        used.add(word.lower())
        words.append(word)
    return words


def plain(text: str) -> str:
    """Return text in one line, without the characters that XML cannot hold."""
    allowed = re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", text)
    return re.sub(r"\s+", " ", allowed).strip()


def library(
    sources: dict[str, str], name: str, version: str, compiler: str = "cc"
) -> tuple[str, bytes]:
    """Return the place in an FMU of a library of C99 sources, and the library.

    Parameters
    ----------
    sources : dict
        Texts by the files' names; those in .c are compiled.
    version : "2.0" or "3.0"
        Of FMI, which names the place.

    Raises
    ------
    InputError
        If the compiler is missing, fails, or builds for a system that FMI does not know.
    """
    command = compiler_path(compiler)
    with TemporaryDirectory(prefix="polefence-") as temporary:
        folder = Path(temporary)
        where, ending = platform(_run(command, ["-dumpmachine"], folder), version)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
        library_name = f"{name}.{ending}"
        flags = [flag for flag in FLAGS if not (ending == "dll" and flag == "-fPIC")]
        # in the folder, so that its name is nowhere in the library
        _run(
            command, [*flags, "-o", library_name, *(f for f in sources if f.endswith(".c"))], folder
        )
        try:
            return f"binaries/{where}/{library_name}", (folder / library_name).read_bytes()
        except OSError as error:
            raise InputError(
                f"compiler {compiler!r} reported success and wrote no library; use gcc or clang"
            ) from error


def platform(target: str, version: str) -> tuple[str, str]:
    """Return the folder in binaries/ and the ending of a library, of a compiler's target.

    Parameters
    ----------
    target : str
        As ``-dumpmachine`` says it: x86_64-linux-gnu, arm64-apple-darwin23.
    version : "2.0" or "3.0"

    Raises
    ------
    InputError
        If FMI has no name for it.
    """
    machine, _, rest = target.strip().lower().partition("-")
    known = [name for pattern, name in MACHINES if re.fullmatch(pattern, machine)]
    systems = [entry for entry in SYSTEMS if any(word in rest for word in entry[0])]
    if not known or not systems:
        raise InputError(
            f"the compiler builds for {_line(target)!r}, where no FMU runs; name one that builds "
            "for Linux, macOS or Windows"
        )
    _, system, old, ending = systems[0]
    if version == "2.0":
        return old + ("64" if "64" in known[0] else "32"), ending
    return f"{known[0]}-{system}", ending


def compiler_path(compiler: str) -> str:
    """Return the path of a compiler.

    Raises
    ------
    InputError
        If it is missing.
    """
    try:
        path = shutil.which(compiler)
    except ValueError:  # a name that no file can have
        path = None
    if path is None:
        raise InputError(
            f"compiler {compiler!r} is not found; an FMU holds compiled C: install gcc or clang "
            "(Debian: apt install gcc; macOS: xcode-select --install), or name yours in CC"
        )
    return os.path.abspath(path)


def _run(compiler: str, arguments: list[str], folder: Path) -> str:
    try:
        done = subprocess.run(  # noqa: S603  (the caller names the compiler)
            [compiler, *arguments],
            cwd=folder,
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise InputError(
            f"compiler {compiler!r} took more than {TIMEOUT} s; use gcc or clang"
        ) from error
    except OSError as error:
        raise InputError(
            f"compiler {compiler!r} cannot be started: {error.strerror}; use gcc or clang"
        ) from error
    if done.returncode != 0:
        lines = done.stderr.decode(errors="replace").splitlines()
        told = next((line for line in lines if "error" in line.lower()), "".join(lines[:1]))
        raise InputError(
            f"compiler {compiler!r} failed (exit {done.returncode}): {_line(told) or 'no message'}"
            "; use gcc or clang"
        )
    return done.stdout.decode(errors="replace")


def _line(text: str) -> str:
    shown = "".join(c if c.isprintable() else " " for c in text)
    return " ".join(shown.split())[:200]
