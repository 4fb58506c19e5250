"""Exported code on this machine and on an emulated Cortex-M4F, with bit-equal random inputs."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polefence import Design
from polefence.export.board import start_sources
from polefence.export.program import Fixed, Program, amid, number, program
from polefence.export.sources import Texts, sources
from polefence.export.vectors import harness, makefile
from polefence.law.laws import Law, PolynomialGain, right_divide
from support.cycles import most
from support.paths import ROOT

HERE = ROOT / "tests" / "export" / "target"
HOST_TOOLS = ("cc", "make")
TOOLS = (*HOST_TOOLS, "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
STRICT = ["-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion"]
STRICT += ["-Wdouble-promotion", "-Wshadow", "-Werror"]
CORTEX = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
# Not to run on for ever, where the emulated program does.
SECONDS = 120


def missing_tools(tools: tuple[str, ...] = TOOLS) -> list[str]:
    return [tool for tool in tools if shutil.which(tool) is None]


def run(*words: object, cwd: Path | None = None, status: int = 0) -> str:
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, capture_output=True, text=True, timeout=SECONDS
    )
    if done.returncode != status:
        raise AssertionError(f"{words[0]} ended with {done.returncode}: {done.stdout}{done.stderr}")
    return done.stdout


@dataclass(frozen=True, eq=False)
class Export:
    """A folder with exported code named law, its test, and random inputs."""

    folder: Path
    program: Program
    law: Law

    @property
    def given(self) -> int:
        if isinstance(self.program, Fixed):
            return 0
        return len(self.program.shares) or self.program.domain.corners

    @property
    def real(self) -> type:
        return np.float32 if self.program.number.bits == 32 else np.float64

    def host(self, source: str, *defines: str, level: str = "-O2") -> Path:
        """Compile law.c and a program for this machine."""
        return self._compiled(["cc", *STRICT, level], [], source, "host", defines)

    def target(self, source: str, *defines: str, level: str = "-O2") -> Path:
        """Compile law.c and a program for the Cortex-M4F."""
        compiler = ["arm-none-eabi-gcc", *STRICT, *CORTEX, level]
        for name, text in start_sources("law").items():
            (self.folder / name).write_text(text)
        board = ["--specs=rdimon.specs", "-nostartfiles", "-T", "law_start.ld"]
        self._object(compiler, Path("law_start.c"), "start", ())
        return self._compiled(compiler, [*board, "start.o"], source, "target", defines)

    def _object(self, compiler: list[str], source: Path, name: str, defines: tuple) -> str:
        words = ["-I", ".", "-I", HERE, *defines, "-fstack-usage", "-c", source, "-o", f"{name}.o"]
        run(*compiler, *words, cwd=self.folder)
        return f"{name}.o"

    def _compiled(self, compiler, link, source, where, defines) -> Path:
        inside = self.folder / source
        own = inside if inside.exists() else HERE / source
        parts = [
            self._object(compiler, Path("law.c"), f"law_{where}", ()),
            self._object(compiler, own, f"{own.stem}_{where}", defines),
        ]
        built = self.folder / f"{own.stem}_{where}"
        run(*compiler, *parts, *link, "-o", built, cwd=self.folder)
        return built

    def drawn(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the inputs that target/draw.h draws, in the code's format: given and x."""
        real, n = self.real, self.program.shape[0]
        each = self.given + n
        values, spare = _uniform(count * each, real)
        values, spare = values.reshape(count, each), spare.reshape(count, each)
        given, x = values[:, : self.given], values[:, self.given :]
        ends = spare[:, : self.given] & 15
        given = np.where(ends < 2, ends.astype(real), given)
        scale = np.array([2.0**-11, 2.0**-5, 1, 1024], dtype=real)
        x = (real(2) * x - real(1)) * scale[spare[:, self.given :] & 3]
        if not isinstance(self.program, Fixed):
            given = self._inside(given)
        assert given.dtype == x.dtype == real
        return given, x

    def _inside(self, part: np.ndarray) -> np.ndarray:
        real = self.real
        if self.program.shares:
            low = np.array([share.low for share in self.program.shares], dtype=real)
            high = np.array([share.high for share in self.program.shares], dtype=real)
            return np.minimum(low + (high - low) * part, high)
        total = np.zeros(len(part), dtype=real)
        for column in part.T:  # in the order of the code, whose sum this is to the last bit
            total = total + column
        part = np.where((total <= 0)[:, None], np.eye(1, part.shape[1], dtype=real), part)
        return part / np.where(total <= 0, real(1), total)[:, None]

    def answers(self, built: Path, count: int, where: str) -> np.ndarray:
        """Run many.c; return u of each input."""
        (self.folder / "u.bin").unlink(missing_ok=True)
        run(*(emulated(built) if where == "target" else [built]), cwd=self.folder)
        return np.fromfile(self.folder / "u.bin", dtype=self.real).reshape(count, -1)

    def errors(self, u: np.ndarray) -> tuple[float, float]:
        """Return the largest errors of u, relative to sum |K| |x|: by a gain corrected, and as is.

        The correction is that of `law.gain` by its residual in longer numbers: in doubles alone it
        is less exact than the code in doubles, whose W is near the identity.
        """
        given, x = (each.astype(float) for each in self.drawn(len(u)))
        alpha = self._alpha(given)
        plain = self._gain(alpha)
        exact = alpha is None or isinstance(self.law, PolynomialGain)
        right = plain if exact else plain + self._correction(alpha, plain)
        scale = np.einsum("...ij,...j->...i", np.abs(plain), np.abs(x))
        return tuple(
            float((np.abs(u - np.einsum("...ij,...j->...i", K, x)) / scale).max())
            for K in (right, plain)
        )

    def _gain(self, alpha: np.ndarray | None) -> np.ndarray:
        if isinstance(self.law, PolynomialGain):
            return self.law.gains[0] if alpha is None else self.law.own_gain(alpha, clamp=True)
        return self.law.gain(alpha, clamp=True)

    def _correction(self, alpha: np.ndarray, K: np.ndarray) -> np.ndarray:
        a = alpha.astype(np.longdouble)
        a = a / a.sum(axis=1, keepdims=True)
        c = self.law.domain.coordinates(a)
        weights = [many * np.prod(c ** np.array(e), axis=1) for many, e in self.program.weights()]
        basis = np.stack(weights, axis=1)
        Z, W = (np.einsum("kc,cij->kij", basis, each) for each in (self.law.Z, self.law.W))
        residual = Z - np.einsum("kij,kjl->kil", K, W)
        return right_divide(residual.astype(float), W.astype(float))

    def _alpha(self, given: np.ndarray) -> np.ndarray | None:
        if isinstance(self.program, Fixed):
            return None
        if not self.program.shares:
            return given
        alpha = np.ones((len(given), 1))
        for k, p in enumerate(share.parameter for share in self.program.shares):
            low, high, value = (p.scheduling(v) for v in (p.low, p.high, given[:, k]))
            weight = np.clip((value - float(low)) / float(high - low), 0, 1)
            pair = np.stack([1 - weight, weight], axis=1)
            alpha = (alpha[:, :, None] * pair[:, None, :]).reshape(len(given), -1)
        return alpha

    def counted(self, level: str, inputs: int = 20) -> tuple[np.ndarray, int]:
        """Return the executed instructions of updates with random inputs, and bytes of stack."""
        built = self.target("count.c", f"-DINPUTS={inputs}U", level=level)
        rows = [line.split() for line in run(*emulated(built, counting=True)).splitlines()]
        loop, counts, stacks = (
            np.array([float(value) for kind, value in rows if kind == wanted])
            for wanted in ("loop", "update", "stack")
        )
        assert len(counts) == len(stacks) == inputs
        # two an iteration, and the call: the clock is what it is taken for
        assert abs(loop[0] - 2) < 1e-3, loop
        # whole numbers, to what a tick of the timer leaves open
        assert np.all(np.abs(counts - np.round(counts)) < 0.25), counts
        return np.round(counts).astype(int), int(stacks.max())

    def size(self, level: str) -> int:
        """Return bytes of code and constants, without what the compiler's library adds."""
        self._object(["arm-none-eabi-gcc", *STRICT, *CORTEX, level], Path("law.c"), "size", ())
        numbers = run("arm-none-eabi-size", "size.o", cwd=self.folder).splitlines()[1].split()
        text, data, bss = (int(word) for word in numbers[:3])
        assert data == bss == 0  # nothing kept between calls
        return text

    def stack(self, level: str) -> int:
        """Return what the compiler says of stack, in bytes: at most all functions are open."""
        self._object(["arm-none-eabi-gcc", *STRICT, *CORTEX, level], Path("law.c"), "size", ())
        rows = (self.folder / "size.su").read_text().splitlines()
        assert rows
        assert all(row.endswith("\tstatic") for row in rows)  # known when compiled
        return sum(int(row.split("\t")[1]) for row in rows)

    def traced(self, level: str) -> int:
        """Return the instructions of one update, from the emulator's list of all it executes.

        Those of law.c alone: with float64 also the library executes some.
        """
        return len(self._executed(level, 1)[1])

    def cycles(self, level: str, inputs: int = 20) -> int:
        """Return a bound on the cycles of an update: of the largest of some, with random inputs.

        Of the instructions that were executed, each with the most cycles that are published of it,
        from a memory without wait states. Of law.c alone: use it with float32.
        """
        built, executed = self._executed(level, inputs)
        listing = run("arm-none-eabi-objdump", "-d", "--no-show-raw-insn", built)
        pattern = r"^ *([0-9a-f]+):\t(\S+)(?:\t([^;@\n]*))?"
        costs = {
            int(at, 16): most(*rest)
            for at, *rest in re.findall(pattern, listing, re.M)
            if int(at, 16) in set(executed)
        }
        entry = re.search(r"^([0-9a-f]+) <law_update>", listing, re.M)
        begins = [k for k, at in enumerate(executed) if at == int(entry[1], 16)]
        assert len(begins) == inputs
        ends = [*begins[1:], len(executed)]
        return max(
            sum(costs[at] for at in executed[begin:end])
            for begin, end in zip(begins, ends, strict=True)
        )

    def _executed(self, level: str, inputs: int) -> tuple[Path, list[int]]:
        """Return a program with so many updates, and where the instructions of law.c were."""
        built = self.target("many.c", f"-DCOUNT={inputs}U", level=level)
        found = run("arm-none-eabi-nm", "--print-size", built)
        pattern = r"^(\w+) (\w+) [tT] (\w+)$"
        sizes = {name: f"0x{at}+0x{size}" for at, size, name in re.findall(pattern, found, re.M)}
        own = run("arm-none-eabi-nm", "law_target.o", cwd=self.folder)
        names = re.findall(r" [tT] (\w+)$", own, re.M)
        log = self.folder / "trace.txt"
        trace = [*_one_by_one(), "-d", "exec,nochain", "-D", log]
        ranges = ["-dfilter", ",".join(sizes[name] for name in names)]
        run(*emulated(built), *trace, *ranges, cwd=self.folder)
        places = re.findall(r"^Trace.*?\[[0-9a-f]+/([0-9a-f]+)/", log.read_text(), re.M)
        return built, [int(at, 16) for at in places]


def emulated(built: Path, counting: bool = False) -> list[object]:
    """Return the command that runs a program on the emulated board."""
    words = "qemu-system-arm -M mps2-an386 -cpu cortex-m4 -nographic -monitor none -serial none"
    clock = ["-icount", "shift=0"] if counting else []
    semihosting = ["-semihosting-config", "enable=on,target=native"]
    return [*words.split(), *clock, *semihosting, "-kernel", built]


def _one_by_one() -> list[str]:
    """Return the option that lets the emulator list each instruction; since 8.1 another."""
    version = re.search(r"version (\d+)\.(\d+)", run("qemu-system-arm", "--version"))
    old = (int(version[1]), int(version[2])) < (8, 1)
    return ["-singlestep"] if old else ["-accel", "tcg,one-insn-per-tb=on"]


def _mixed(n: np.ndarray) -> np.ndarray:
    n = n ^ (n >> np.uint32(16))
    n = n * np.uint32(0x7FEB352D)
    n = n ^ (n >> np.uint32(15))
    n = n * np.uint32(0x846CA68B)
    return n ^ (n >> np.uint32(16))


def _uniform(count: int, real: type) -> tuple[np.ndarray, np.ndarray]:
    high, low = _mixed(np.arange(2 * count, dtype=np.uint32)).reshape(count, 2).T
    spare = (low & np.uint32(63)).astype(int)
    if real is np.float32:
        return (high >> np.uint32(8)).astype(real) / real(2**24), spare
    whole = (high >> np.uint32(5)).astype(real) * real(2**26)
    return (whole + (low >> np.uint32(6)).astype(real)) / real(2**53), spare


def export(
    design: Design,
    bits: int,
    folder: Path,
    given: str = "parameters",
    limits: tuple[float, ...] = (),
) -> Export:
    """Write the sources, the test with its Makefile, and the bounds for draw.h."""
    shares = design.plant.parameters if given == "parameters" else ()
    made = amid(program(design.law, shares, number(bits)), design.law)
    n, m = made.shape
    texts = Texts(
        name="law",
        title=design.plant.name,
        statement=("Not for use: a test.",),
        states=tuple(f"state {j + 1}" for j in range(n)),
        inputs=tuple(f"input {i + 1}" for i in range(m)),
        limits=limits,
    )
    folder.mkdir(parents=True, exist_ok=True)
    files = sources(made, texts) | {
        "law_test.c": harness(made, texts, design.law),
        "Makefile": makefile(texts),
        "inputs.h": _bounds(made),
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    return Export(folder, made, design.law)


def _bounds(made: Program) -> str:
    if isinstance(made, Fixed) or not made.shares:
        return ""
    lines = []
    for name, values in (
        ("LOW", [share.low for share in made.shares]),
        ("HIGH", [share.high for share in made.shares]),
    ):
        numbers = ", ".join(made.number.text(value) for value in values)
        lines.append(f"static const law_real {name}[LAW_PARAMETERS] = {{ {numbers} }};\n")
    return "".join(lines)
