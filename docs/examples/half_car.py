"""A half car: one law for every load and age, proved, and both axles over a bump; figure.

``python docs/examples/half_car.py [FOLDER]`` prints the page's numbers and writes half-car.png
into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

SPEC = pf.examples.spec_path("half-car")
REGION = pf.parse_region("half_plane(1) & sector(0.1)")
DENSITY = pf.vehicle.velocity_density("C", 20)  # road of class C at 20 m/s
PITCH = pf.Rms("pitch acceleration", at_most=1.02, density=DENSITY)  # as the passive car
PASSIVE = np.zeros((2, 8))
LOADS = {"no load": {"felt": 322.1, "age": 0}, "100 kg": {"felt": 422, "age": 0}}
SIGNALS = ("driver acceleration", "pitch acceleration", "front force", "rear force")
STYLES = {"passive": "#e08214", "law, pitch limited": "#2166ac"}
HEIGHT, LENGTH, SPEED = 0.04, 2.0, 10.0  # of the bump [m], of the car [m/s]


def designed(plant, *more):
    """One gain of all states, with the least proved acceleration of the driver."""
    least, limits = pf.load_specifications(SPEC)
    return pf.optimise(plant, least, [*limits, *more], REGION, method="quadratic")


def proved(plant, law, names):
    """The rms of these signals, for every load and age."""
    limits = [pf.Rms(name, at_most=10, density=DENSITY) for name in names]
    found = pf.analyse(plant, law, pf.HalfPlane(0), limits=limits).bounds
    return [own.bound.level for own in found]


def driven(plant, law):
    """Both loads over the bump, the rear wheel later; time [s] and the drive."""
    road = pf.vehicle.bump(HEIGHT, LENGTH, before=1.0, after=SPEED * 3)
    places = pf.vehicle.load_car(SPEC).places
    ride = pf.vehicle.on_wheels(plant, places, road, SPEED, step=5e-4, duration=2.0)
    return ride.times, pf.vehicle.drive(plant, law, ride, list(LOADS.values()))


def draw(drives, folder):
    """Draw the accelerations of driver and pitch of both cars, with both loads."""
    figure, axes = pf.plots.new_figure(2, 9.5, 3.6)
    for name, (time, drive) in drives.items():
        found = drive.response(list(SIGNALS)[:2]).values
        for values, load, style in zip(found, LOADS, ("-", "--"), strict=True):
            for ax, own in zip(axes, values.T, strict=True):
                label = f"{name.split(',')[0]}, {load}"
                ax.plot(time, own, style, color=STYLES[name], lw=1.2, label=label)
    axes[0].set(ylabel="driver's acceleration [m/s²]")
    axes[1].set(ylabel="pitch acceleration [rad/s²]")
    for ax in axes:
        ax.set(xlabel="time [s]", xlim=(0, 1.5))
    axes[1].legend(fontsize=8.5, loc="lower right")
    Path(folder, "half-car.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Design, prove, drive, print and draw."""
    plant = pf.load(SPEC)
    free, limited = designed(plant), designed(plant, PITCH)
    rms = {"passive": proved(plant, PASSIVE, SIGNALS[:2])}
    for name, own in (("law, pitch left free", free), ("law, pitch limited", limited)):
        rms[name] = [own.bounds[0].level, *proved(plant, own.law, SIGNALS[1:2])]
    print("rms, proved for every load and age:")
    for name, (driver, pitch) in rms.items():
        # what nothing asks for hardly changes the driver's: a search ends anywhere near
        shown = f"over {np.floor(2 * pitch) / 2:.1f}" if "free" in name else f"{pitch:.3f}"
        print(f"  {name}: driver {driver:.3f} m/s2, pitch {shown} rad/s2")
    drives = {"passive": driven(plant, PASSIVE), "law, pitch limited": driven(plant, limited.law)}
    print(f"peaks over a bump of {1e3 * HEIGHT:.0f} mm, simulated:")
    for name, (_, drive) in drives.items():
        found = drive.response(list(SIGNALS)).values
        for load, (driver, pitch, *forces) in zip(LOADS, np.abs(found).max(axis=1), strict=True):
            shown = f"driver {driver:.2f} m/s2, pitch {pitch:.2f} rad/s2, force {max(forces):.0f} N"
            print(f"  {name}, {load}: {shown}")
    draw(drives, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
