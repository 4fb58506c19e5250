"""C sources made a shared library by the compiler of this machine."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from polefence.base.errors import InputError

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
    found = _found(compiler)
    with TemporaryDirectory(prefix="polefence-") as temporary:
        folder = Path(temporary)
        where, ending = platform(_run(found, ["-dumpmachine"], folder), version)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
        own = f"{name}.{ending}"
        flags = [flag for flag in FLAGS if not (ending == "dll" and flag == "-fPIC")]
        # in the folder, so that its name is nowhere in the library
        _run(found, [*flags, "-o", own, *(f for f in sources if f.endswith(".c"))], folder)
        try:
            return f"binaries/{where}/{own}", (folder / own).read_bytes()
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
    systems = [own for own in SYSTEMS if any(word in rest for word in own[0])]
    if not known or not systems:
        raise InputError(
            f"the compiler builds for {_line(target)!r}, where no FMU runs; name one that builds "
            "for Linux, macOS or Windows"
        )
    _, system, old, ending = systems[0]
    if version == "2.0":
        return old + ("64" if "64" in known[0] else "32"), ending
    return f"{known[0]}-{system}", ending


def _found(compiler: str) -> str:
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
