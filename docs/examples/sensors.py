"""Which sensors are worth what: proved ride of a quarter car against what its law measures; figure.

``python docs/examples/sensors.py [FOLDER]`` writes sensors.png into the folder, by default here.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

import polefence as pf
from polefence.base.files import write_bytes

DEFLECTION, BODY, WHEEL = (
    "suspension deflection",
    "sprung-mass velocity",
    "unsprung-mass velocity",
)
SETS = {
    "deflection, body velocity": (DEFLECTION, BODY),
    "deflection, both velocities": (DEFLECTION, BODY, WHEEL),
    "all four states": (DEFLECTION, "tyre deflection", BODY, WHEEL),
}
FORMS = {"one gain": (), "affine in the load": ("m1",), "affine in load and age": ("m1", "beta")}
REGION = pf.HalfPlane(1) & pf.Sector(0.15)


def car():
    """Return the study's car behind an actuator of 30 Hz, what is minimised, and the limits."""
    spec = pf.examples.spec_path("quarter-car-ride")
    plant = pf.with_actuator(pf.load(spec), "actuator force", 30)
    return plant, *pf.load_specifications(spec)


def table():
    """Return the proved rms, and the number of numbers in the law, for each set and form."""
    plant, least, limits = car()
    found = {}
    for label, measured in SETS.items():
        for form, schedule in FORMS.items():
            structure = pf.Structure(measured=measured, schedule=schedule)
            try:
                done = pf.optimise(plant, least, limits, REGION, structure=structure)
            except pf.NotProvedError:
                continue
            numbers = len(measured) * (1 + len(schedule))
            found[label, form] = (numbers, done.bounds[0].level)
    return found


def figure(found):
    """Draw the bound over the size of the law, a line a set of sensors."""
    drawn, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
    for marker, label in zip("os^", SETS, strict=True):
        own = [found[label, form] for form in FORMS if (label, form) in found]
        if own:
            axes.plot(*zip(*own, strict=True), marker=marker, label=label)
    axes.axhline(1.0206, color="0.5", linestyle=":")
    axes.annotate("refuted for every law", (2, 1.0200), va="top", color="0.4")
    axes.set_ylim(1.012, None)
    axes.set(xlabel="numbers in the law", ylabel="proved rms of acceleration [m/s²]")
    axes.legend(frameon=False)
    return drawn


def main(folder="."):
    """Tune, print and draw."""
    found = table()
    for (label, form), (numbers, level) in found.items():
        print(f"{label:<28} {form:<24} {numbers:>3} numbers  {level:.5f} m/s2")
    write_bytes(Path(folder) / "sensors.png", pf.plots.render(figure(found), "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
