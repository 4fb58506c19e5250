"""The quarter car's law as C on an emulated Cortex-M4F, in the loop with the car; figure.

``python docs/examples/cortex.py [FOLDER]`` prints the page's numbers and writes cortex.png into
the folder, by default here. It needs cc, arm-none-eabi-gcc with newlib and qemu-system-arm, on
Linux, and takes some ten seconds.
"""

import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import polefence as pf
from polefence.response.discrete import zero_order_hold

PERIOD, SAMPLES = 0.001, 1000  # [s]; of a drive
LOADS = {240: "#2166ac", 340: "#b2182b"}  # of two cars [kg]
# What has to be there, and the Debian packages that have it.
TOOLS = {
    "cc": "gcc",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "arm-none-eabi-size": "gcc-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
}
STRICT = ["-std=c99", "-ffp-contract=off", "-Wall", "-Wextra"]
CORTEX = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
# newlib starts the program, reads and writes, by the emulator's semihosting
BOARD = ["--specs=rdimon.specs", "-Wl,--section-start=.vectors=0,-Ttext=0x100,-Tdata=0x20000000"]
# an instruction is a nanosecond of the emulator's clock
EMULATOR = [
    *("qemu-system-arm", "-M", "mps2-an386", "-cpu", "cortex-m4", "-icount", "shift=0"),
    *("-nographic", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native", "-kernel"),
]
# One program for host and target: parameters and x in, u and flags out, at every sample. At last
# the target tells how many instructions an update takes. Its timer ticks every 40 of them, so
# that of 4000 calls it takes 100 ticks for each; 4000 calls of a mere return are taken off.
MAIN = r"""
#include "law.h"
#include <stdio.h>

static struct { law_real p[LAW_PARAMETERS], x[LAW_STATES]; } given;
static struct { law_real u[LAW_INPUTS]; uint32_t flags; } answer;

#ifdef TARGET
#define TIMER ((volatile uint32_t *)0xE000E010)
typedef uint32_t (*function)(const law_real *, const law_real *, law_real *);

uint32_t nothing(const law_real *p, const law_real *x, law_real *u);
__asm__(".syntax unified\n.thumb_func\nnothing: bx lr\n");

static __attribute__((noinline)) uint32_t ticks(function called)
{
    uint32_t begin, k;

    TIMER[1] = 0xFFFFFF;
    TIMER[2] = 0;
    TIMER[0] = 5;
    begin = TIMER[2];
    for (k = 0; k < 4000; k++) {
        called(given.p, given.x, answer.u);
    }
    return (begin - TIMER[2]) & 0xFFFFFF;
}

extern void _start(void);

static void reset(void)
{
    *(volatile uint32_t *)0xE000ED88 |= 0xF << 20; /* the floating-point unit */
    __asm__ volatile("dsb\nisb");
    _start();
}

struct table { uint32_t stack; void (*start)(void); };
__attribute__((section(".vectors"), used)) static const struct table vectors = {0x20400000, reset};
#endif

int main(void)
{
    FILE *in = fopen("/dev/fd/0", "rb"), *out = fopen("/dev/fd/1", "wb");

    while (fread(&given, sizeof given, 1, in) == 1) {
        answer.flags = law_update(given.p, given.x, answer.u);
        fwrite(&answer, sizeof answer, 1, out);
        fflush(out);
    }
#ifdef TARGET
    answer.flags = 1 + (ticks(law_update) - ticks(nothing) + 50) / 100;
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


def exported():
    """Design, and its law as float32 code; u acts one sample late."""
    design = pf.place(pf.examples.family("quarter-car-physical"), pf.Disk(-40, 31), "scheduled")
    sampling = pf.export.Sampling(PERIOD, delayed=True)
    return design, pf.export.export_c99(design, 32, sampling=sampling)


def built(folder, name, level="-O2"):
    """Compile a folder's law.c for "target" or "host"; return the command that runs it."""
    Path(folder, "main.c").write_text(MAIN)
    tool, link = ["cc"], []
    if name == "target":
        tool, link = ["arm-none-eabi-gcc", *CORTEX, "-DTARGET"], BOARD
    parts = [f"{name}{level}-{part}.o" for part in ("law", "main")]
    for source, part in zip(("law.c", "main.c"), parts, strict=True):
        run(*tool, *STRICT, level, "-c", source, "-o", part, cwd=folder)
    run(*tool, *parts, *link, "-o", f"{name}{level}", cwd=folder)
    return [*(EMULATOR if name == "target" else []), str(Path(folder, f"{name}{level}"))]


def size(folder, level="-O2"):
    """Bytes of code and constants of the law on the target."""
    said = run("arm-none-eabi-size", f"target{level}-law.o", cwd=folder)
    return int(said.splitlines()[1].split()[0])


class Processor:
    """A running program. A call of parameters and x returns u; `answers` has the bits of all."""

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


def road(plant):
    """A bump of 30 mm over 2.5 m, at 10 m/s."""
    return pf.vehicle.on_road(plant, pf.vehicle.bump(0.03, 2.5), 10, PERIOD, SAMPLES * PERIOD)


def driven(plant, load, law):
    """Drive over the bump, u one sample late; return x and u at the samples."""
    A, B = plant.at(plant.alpha(m1=load, beta=0))
    E = plant.vertices[0].E  # the same for every car
    step, enter = zero_order_hold(A, np.hstack([B, E]), PERIOD)
    x, late, states, forces = np.zeros(5), 0.0, [], []
    for w in road(plant).w[:, 0]:
        u = law(x)
        states.append(x)
        forces.append(u)
        x, late = step @ x + enter @ [late, w], u
    return np.array(states), np.array(forces)


def errors(design, code, load, x, u):
    """Return the error of each u, of x as the code is given it, and what is proved of it [N]."""
    x = x.astype(np.float32).astype(float)
    exact = x @ design.law.gain_at(m1=load, beta=0)[0]
    return np.abs(u - exact), code.guarantee.bound(x)[:, 0]


def ideal(design, load):
    """Return u of the law in continuous time over the same bump [N]."""
    found = pf.vehicle.drive(design.plant, design.law, road(design.plant), {"m1": load, "beta": 0})
    return found.demanded[0, :-1, 0]


def draw(found, folder):
    """Draw the forces, and what sampling and rounding do to them."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 3.8)
    time = PERIOD * np.arange(SAMPLES)
    for load, (u, wanted, _, _) in found.items():
        left.plot(time, wanted / 1e3, color=LOADS[load], lw=1.1, label=f"{load} kg, ideal")
        own = {"ls": "", "marker": "o", "ms": 3.4, "mfc": "none", "mew": 0.9}
        left.plot(time[::12], u[::12] / 1e3, color=LOADS[load], **own, label=f"{load} kg, target")
    left.set(xlabel="time [s]", ylabel="actuator force [kN]", title="force over the bump")
    left.legend(fontsize=8.5)
    u, wanted, error, bound = found[max(found)]
    moving = bound > 0
    for values, label, colour, width in (
        (np.abs(u - wanted), "sampling and delay", "0.6", 1.0),
        (bound, "rounding, proved bound", "#b2182b", 1.8),
        (error, "rounding, found", "black", 0.6),
    ):
        right.semilogy(time[moving], values[moving], color=colour, lw=width, label=label)
    right.set(xlabel="time [s]", ylabel="difference of force [N]", ylim=(1e-12, 1e3))
    right.set_title(f"off the ideal force, {max(found)} kg")
    right.legend(fontsize=8.5, loc="lower left")
    for ax in (left, right):
        ax.set_xlim(0, PERIOD * SAMPLES)
    Path(folder, "cortex.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Export, compile, drive, compare, print and draw."""
    require_tools()
    design, code = exported()
    print("\n".join(code.texts.statement))
    found, same, instructions = {}, True, {}
    with TemporaryDirectory() as place:
        code.save(place)
        target, other, host = (
            built(place, *own) for own in (("target",), ("target", "-O3"), ("host",))
        )
        for load in LOADS:
            with Processor(target) as processor:
                x, u = driven(design.plant, load, lambda x, of=processor, p=load: of([p, 0, *x]))
            instructions["-O2"] = processor.instructions
            for level, command in (("-O3", other), ("host", host)):
                with Processor(command) as again:
                    for state in x:
                        again([load, 0, *state])
                instructions[level] = again.instructions
                same = same and again.answers == processor.answers
            found[load] = u, ideal(design, load), *errors(design, code, load, x, u)
        sizes = {level: size(place, level) for level in ("-O2", "-O3")}
    version = re.search(r"\d+\.\d+", run("arm-none-eabi-gcc", "-dumpfullversion", cwd="."))[0]
    print(f"arm-none-eabi-gcc {version}, one update:")
    for level, own in sizes.items():
        print(f"  {level}: {instructions[level]} instructions, {own} bytes")
    print(f"{len(LOADS) * SAMPLES} updates, bits equal on target and host: {same}")
    print("load     peak of u   sampling, delay   bound of rounding   rounding")
    for load, (u, wanted, error, bound) in found.items():
        late = np.abs(u - wanted).max()
        print(
            f"{load} kg {np.abs(u).max():9.0f} N {late:15.1f} N {bound.max():17.2f} N "
            f"{error.max():8.1g} N"
        )
    draw(found, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
