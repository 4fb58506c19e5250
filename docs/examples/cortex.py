"""The quarter car's law as C on an emulated Cortex-M4F, in the loop with the car; figure.

``python docs/examples/cortex.py [FOLDER]`` prints the page's numbers and writes cortex.png into
the folder, by default here. It needs cc, arm-none-eabi-gcc with newlib and qemu-system-arm, on
Linux, and takes some ten seconds.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from board import Processor, built, compiler, in_the_loop, require_tools, size

import polefence as pf

PERIOD, SAMPLES = 0.001, 1000  # [s]; of a drive
LOADS = {240: "#2166ac", 340: "#b2182b"}  # of two cars [kg]


def exported():
    """Design, and its law as float32 code; u acts one sample late."""
    design = pf.place(pf.examples.family("quarter-car-physical"), pf.Disk(-40, 31), "scheduled")
    sampling = pf.export.Sampling(PERIOD, delay=1)
    return design, pf.export.export_c99(design, 32, sampling=sampling)


def road(plant):
    """A bump of 30 mm over 2.5 m, at 10 m/s."""
    return pf.vehicle.on_road(plant, pf.vehicle.bump(0.03, 2.5), 10, PERIOD, SAMPLES * PERIOD)


def driven(plant, load, law):
    """Drive over the bump, u one sample late; return x and u at the samples."""
    alpha = plant.alpha(m1=load, beta=0)
    return in_the_loop(plant, alpha, law, road(plant).w, PERIOD)


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
    print(f"{compiler()}, one update:")
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
