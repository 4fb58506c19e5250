"""Laws of the light van on an emulated Cortex-M4F, in the loop with the van on a road; figure.

``python docs/examples/car_to_board.py [FOLDER [DESIGN DESIGN]]`` prints the page's numbers and
writes car-to-board.png into the folder, by default here. The designs are those that the page's
`optimise` wrote; by default they are made here, in half a minute. It needs what cortex.py needs.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from board import Processor, built, compiler, in_the_loop, require_tools, size

import polefence as pf

SPEC = pf.examples.spec_path("van")
# What the page adds to the spec.
GRIP = """
[outputs]                       # kt x2, as a share of the load's weight
"tyre load [-]" = {C = [0, "kt/m1/9.81", 0, 0]}

[[specification]]
kind = "rms"
signal = "tyre load"
at_most = 0.39                  # a third of what the empty van's wheel carries: 328 kg
"""
PERIOD, SAMPLES = 0.001, 4000  # [s]; of a drive
SPEED, SHOWN = 20, (1.5, 3.5)  # [m/s]; [s]
K, KT, WHEEL = 22000, 210000, 48  # spring and tyre in the middle of their ranges [N/m]; [kg]
LOADS = 280, 620  # empty and full [kg]
COLOURS = {"passive": "0.55", "comfort alone": "#2166ac", "comfort within grip": "#b2182b"}


def designed(more="", region=None):
    """Return the law that the spec asks for, with more text behind it."""
    with TemporaryDirectory() as place:
        spec = Path(place, "van.toml")
        spec.write_text(SPEC.read_text() + more)
        van, structure = pf.load(spec), pf.load_structure(spec)
        return pf.optimise(van, *pf.load_specifications(spec), region, structure=structure).design


def driven(van, load, law):
    """Drive on a road of class C; return the acceleration [m/s2], the tyre's load and u [N]."""
    alpha = van.alpha(m1=load, k=K, kt=KT)
    height = pf.vehicle.random_road("C", SPEED * SAMPLES * PERIOD, 0)
    road = pf.vehicle.on_road(van, height, SPEED, PERIOD, SAMPLES * PERIOD)
    x, u = in_the_loop(van, alpha, law, road.w, PERIOD)
    return x @ van.at(alpha)[0][2], 9.81 * (load + WHEEL) + KT * x[:, 1], u


def on_board(van, design):
    """Export and compile; drive by the target's answers, and ask the host for the same.

    Return the drives, whether all bits are equal, and what an update costs.
    """
    seen = [k for k, name in enumerate(van.states) if name.startswith("measured ")]
    sampling = pf.export.Sampling(PERIOD, delay=1)
    with TemporaryDirectory() as place:
        pf.export.export_c99(design, 32, sampling=sampling).save(place)
        target, host = (built(place, name) for name in ("target", "host"))
        drives, same = [], True
        for load in LOADS:
            with Processor(target) as ours, Processor(host) as again:

                def both(x, ours=ours, again=again):
                    again(x[seen])
                    return ours(x[seen])

                drives.append(driven(van, load, both))
            same = same and ours.answers == again.answers
        return drives, same, f"{ours.instructions} instructions an update, {size(place)} bytes"


def draw(found, folder):
    """Draw acceleration, tyre load and force of the empty van."""
    figure, axes = pf.plots.new_figure(3, 11.5, 3.6)
    time = PERIOD * np.arange(SAMPLES)
    for name, ((acceleration, load, u), _) in found.items():
        for ax, signal in zip(axes, (acceleration, load / 1e3, u / 1e3), strict=True):
            if signal.any():
                ax.plot(time, signal, color=COLOURS[name], lw=1.1, label=name)
    axes[1].axhline(0, color="black", lw=1.1)
    texts = "acceleration of the body [m/s²]", "load on the road [kN]", "demanded force [kN]"
    for ax, text, title in zip(axes, texts, ("comfort", "grip", "what is sent"), strict=True):
        ax.set(xlabel="time [s]", ylabel=text, title=title, xlim=SHOWN)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    Path(folder, "car-to-board.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder=".", *designs):
    """Drive passively and by both laws; print and draw."""
    require_tools()
    laws = [pf.Design.load(own) for own in designs] or [
        designed(),
        designed(GRIP, pf.HalfPlane(0.5)),
    ]
    van = pf.load(SPEC)
    passive, first, second = COLOURS
    found = {passive: [driven(van, load, lambda _: 0.0) for load in LOADS]}
    print(f"{compiler()} -O2, float32, {1000 * PERIOD:g} ms")
    for name, design in zip((first, second), laws, strict=True):
        found[name], same, cost = on_board(van, design)
        print(f"{name}: {cost}; {len(LOADS) * SAMPLES} updates, bits equal on host: {same}")
    print("                               acceleration   tyre load, least   force, largest")
    for name, drives in found.items():
        for load, (acceleration, grip, u) in zip(LOADS, drives, strict=True):
            rms = np.sqrt(np.mean(acceleration**2))
            force = np.abs(u).max() / 1e3
            print(
                f"{name:<20} {load} kg   {rms:5.2f} m/s2 rms {grip.min() / 1e3:12.1f} kN "
                f"{force:12.1f} kN"
            )
    draw(found, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
