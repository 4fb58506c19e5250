"""A law's exported code on this machine and on an emulated Cortex-M4F.

Both run one program: it reads what the law is given at a sample, in float32, and answers with u and
flags. This needs cc, arm-none-eabi-gcc with newlib and qemu-system-arm, on Linux.
"""

import re
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np

from polefence.export.board import start_sources
from polefence.response.discrete import zero_order_hold

# What has to be there, and the Debian packages that have it.
TOOLS = {
    "cc": "gcc",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "arm-none-eabi-size": "gcc-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
}
STRICT = ["-std=c99", "-ffp-contract=off", "-Wall", "-Wextra"]
CORTEX = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
# newlib reads and writes by the emulator's semihosting
BOARD = ["--specs=rdimon.specs", "-nostartfiles", "-T", "law_start.ld"]
# an instruction is a nanosecond of the emulator's clock
EMULATOR = [
    *("qemu-system-arm", "-M", "mps2-an386", "-cpu", "cortex-m4", "-icount", "shift=0"),
    *("-nographic", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native", "-kernel"),
]
# Given are parameters and x, or what is measured where the law has states of its own. At last the
# target tells how many instructions an update takes. Its timer ticks every 40 of them, so that of
# 4000 calls it takes 100 ticks for each; 4000 calls of a mere return are taken off.
MAIN = r"""
#include "law.h"
#include <stdio.h>

#ifdef LAW_MEASURED
static law_memory memory;
static struct { law_real y[LAW_MEASURED]; } given;
#define ARGUMENTS (&memory, given.y, answer.u)
#else
static struct { law_real p[LAW_PARAMETERS], x[LAW_STATES]; } given;
#define ARGUMENTS (given.p, given.x, answer.u)
#endif
static struct { law_real u[LAW_INPUTS]; uint32_t flags; } answer;

#ifdef TARGET
#define TIMER ((volatile uint32_t *)0xE000E010)
#define TICKS(ticks, called)                             \
    static __attribute__((noinline)) uint32_t ticks(void) \
    {                                                    \
        uint32_t begin, k;                               \
                                                         \
        TIMER[1] = 0xFFFFFF;                             \
        TIMER[2] = 0;                                    \
        TIMER[0] = 5;                                    \
        begin = TIMER[2];                                \
        for (k = 0; k < 4000; k++) {                     \
            called ARGUMENTS;                            \
        }                                                \
        return (begin - TIMER[2]) & 0xFFFFFF;            \
    }

uint32_t nothing();
__asm__(".syntax unified\n.thumb_func\nnothing: bx lr\n");
TICKS(of_law, law_update)
TICKS(of_nothing, nothing)
#endif

int main(void)
{
    FILE *in = fopen("/dev/fd/0", "rb"), *out = fopen("/dev/fd/1", "wb");

#ifdef LAW_MEASURED
    law_reset(&memory);
#endif
    while (fread(&given, sizeof given, 1, in) == 1) {
        answer.flags = law_update ARGUMENTS;
        fwrite(&answer, sizeof answer, 1, out);
        fflush(out);
    }
#ifdef TARGET
    answer.flags = 1 + (of_law() - of_nothing() + 50) / 100;
    fwrite(&answer, sizeof answer, 1, out);
    fflush(out);
#endif
    return 0;
}
"""


def require_tools():
    """End with the names of what is missing."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        packages = dict.fromkeys(" ".join(TOOLS[tool] for tool in missing).split())
        needed = " ".join(packages)
        raise SystemExit(f"not found: {', '.join(missing)}; on Debian: apt install {needed}")


def run(*words, cwd):
    """Run a tool and return what it prints; where it fails, end with its message."""
    done = subprocess.run(  # noqa: S603  (tools of the list above)
        words, cwd=cwd, capture_output=True, text=True, check=False
    )
    if done.returncode:
        needed = TOOLS[words[0]]
        raise SystemExit(f"{words[0]} failed (Debian: apt install {needed}):\n{done.stderr}")
    return done.stdout


def built(folder, name, level="-O2"):
    """Compile a folder's law.c for "target" or "host"; return the command that runs it."""
    Path(folder, "main.c").write_text(MAIN)
    tool, link, sources = ["cc"], [], ["law.c", "main.c"]
    if name == "target":
        for file, text in start_sources("law").items():
            Path(folder, file).write_text(text)
        tool, link = ["arm-none-eabi-gcc", *CORTEX, "-DTARGET"], BOARD
        sources.append("law_start.c")
    parts = [f"{name}{level}-{Path(source).stem}.o" for source in sources]
    for source, part in zip(sources, parts, strict=True):
        run(*tool, *STRICT, level, "-c", source, "-o", part, cwd=folder)
    run(*tool, *parts, *link, "-o", f"{name}{level}", cwd=folder)
    return [*(EMULATOR if name == "target" else []), str(Path(folder, f"{name}{level}"))]


def size(folder, level="-O2"):
    """Bytes of code and constants of the law on the target."""
    said = run("arm-none-eabi-size", f"target{level}-law.o", cwd=folder)
    return int(said.splitlines()[1].split()[0])


class Processor:
    """A running program. A call of what the law is given returns u; `answers` has all bits."""

    def __init__(self, command):
        self.process = subprocess.Popen(  # noqa: S603  (what was built here)
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self.answers, self.instructions = [], None

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if kind is not None:
            self.process.kill()
        last, _ = self.process.communicate(timeout=60)
        if len(last) == 8:
            (self.instructions,) = struct.unpack("<4xI", last)

    def __call__(self, given):
        """Return u, once the program has answered."""
        try:
            self.process.stdin.write(np.asarray(given, "<f4").tobytes())
            self.process.stdin.flush()
            answer = self.process.stdout.read(8)
        except BrokenPipeError:
            answer = b""
        if len(answer) < 8:
            raise SystemExit(f"{self.process.args[0]} ended early")
        if any(answer[4:]):
            raise SystemExit(f"the law raises flags for {list(given)}")
        self.answers.append(answer[:4])
        return struct.unpack("<f", answer[:4])[0]


def compiler():
    """Return the version of the target's compiler."""
    said = run("arm-none-eabi-gcc", "-dumpfullversion", cwd=".")
    return f"arm-none-eabi-gcc {re.search(r'[0-9]+[.][0-9]+', said)[0]}"


def in_the_loop(plant, alpha, law, w, period):
    """Run a plant with one input under w, u one sample late; return x and u at the samples."""
    A, B = plant.at(alpha)
    E = plant.vertices[0].E  # the same for every car
    step, enter = zero_order_hold(A, np.hstack([B, E]), period)
    x, late, states, inputs = np.zeros(len(A)), 0.0, [], []
    for each in w:
        u = law(x)
        states.append(x)
        inputs.append(u)
        x, late = step @ x + enter @ [late, *each], u
    return np.array(states), np.array(inputs)
