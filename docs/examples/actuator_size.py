"""How strong must the actuator be? Comfort against force, proved; figure.

``python docs/examples/actuator_size.py [FOLDER]`` prints the page's numbers and writes
actuator-size.png into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

DENSITY = pf.vehicle.velocity_density("C", 20)  # road of class C at 20 m/s
COMFORT = pf.Rms("sprung-mass acceleration", density=DENSITY)
FORCE = pf.Rms("actuator force", density=DENSITY)
LIMITS = (
    pf.Rms("tyre deflection", at_most=0.00472, density=DENSITY),
    pf.Rms("suspension deflection", at_most=0.0266, density=DENSITY),
)
NEWTONS = (75, 100, 150, 250)
METHODS = {"one gain": "quadratic", "scheduled on load and age": pf.Scheduled(1, 0, on="box")}


def fronts():
    """The least acceleration that is proved within each limit on the force, per kind of law."""
    plant = pf.examples.family("quarter-car-ride")
    for label, method in METHODS.items():
        found = pf.tradeoff(plant, COMFORT, FORCE, NEWTONS, LIMITS, methods=[method])
        yield label, [row["proved"] for row in found.rows]


def main(folder="."):
    """Sweep, print and draw."""
    figure, axes = pf.plots.new_figure(1, 6.5, 3.8)
    passive = passive_car()
    print(f"passive: {passive:.4f} m/s2, sampled")
    axes[0].axhline(passive, color="0.4", ls=":", label="passive car, sampled")
    for (label, levels), style in zip(fronts(), ("o-", "s-"), strict=True):
        shown = ", ".join(f"{own:.4f}" for own in levels)
        print(f"{label}: {shown} m/s2 proved with {', '.join(map(str, NEWTONS))} N")
        colour = "#b2182b" if style == "o-" else "#2166ac"
        axes[0].plot(NEWTONS, levels, style, color=colour, label=label)
    axes[0].set(xlabel="limit on the rms of the force [N]", ylabel="acceleration, rms [m/s²]")
    axes[0].legend(fontsize=8.5)
    Path(folder, "actuator-size.png").write_bytes(pf.plots.render(figure, "png"))


def passive_car():
    """The passive car's acceleration at its worst corner."""
    plant = pf.examples.family("quarter-car-ride")
    return COMFORT.values(plant, pf.FixedGain([[0.0] * 4]), np.eye(4)).max()


if __name__ == "__main__":
    main(*sys.argv[1:])
