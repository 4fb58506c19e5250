"""python-control: a gain from its tools verified for a whole family, and its plots; figure.

``python docs/examples/python_control.py [FOLDER]`` prints the page's numbers and writes
python-control.png into the folder, by default here. It needs `pip install 'polefence[control]'`,
and takes some seconds.
"""

import sys
from pathlib import Path

import control as ct
import numpy as np

import polefence as pf

REGION = pf.parse_region("half_plane(1) & sector(0.3) & disk(-150, 150)")
NOMINAL = {"m1": 288.9, "beta": 0}
NAMES = [f"vertex {k}" for k in range(1, 5)]
SIGNAL = ("suspension_deflection", "road_velocity")


def regulator(car):
    """The linear-quadratic regulator of one car, by python-control: u = K x, so its K negated."""
    nominal = ct.ss(pf.to_control(car, car.alpha(**NOMINAL)))
    K, _, _ = ct.lqr(nominal.A, nominal.B[:, :1], np.diag([1e8, 1e8, 1e4, 1e4]), 1e-2)
    return -K


def by_hand(car):
    """One loop as sisotool shows it: a gain of the body's velocity alone, turned until it pleases.

    `ct.sisotool(-10_000 * loop)` opens the window; here the gain is already found.
    """
    loop = pf.to_control(car, car.alpha(**NOMINAL))["sprung_mass_velocity", "actuator_force"]
    gain = 2000.0
    closed = ct.feedback(gain * loop, 1)
    return np.array([[0, 0, -gain, 0]]), ct.poles(closed)


def draw(car, design, folder):
    """Draw the family in python-control's own plots: step, Bode, poles."""
    figure, axes = pf.plots.new_grid(2, 2, 10.0, 6.6)
    loops = pf.closed_loops(car, design)
    signals = [own[SIGNAL] for own in loops]
    for response in ct.step_response(signals, np.linspace(0, 1, 500)):
        axes[0, 0].plot(response.time, response.outputs.ravel())
    axes[0, 0].set(xlabel="time [s]", ylabel="suspension deflection [m]", title="step of the road")
    axes[0, 0].margins(x=0)
    ct.bode_plot(signals, ax=axes[:, 1:], omega=np.geomspace(0.5, 500, 400), title="", label=NAMES)
    for own in loops:
        poles = ct.poles(own)
        axes[1, 0].plot(poles.real, poles.imag, "x")
    pf.plots.draw_region(axes[1, 0], design.region, (-80.0, 10.0, 40.0))
    axes[1, 0].set(xlabel="real part [1/s]", ylabel="imaginary part [rad/s]", aspect="equal")
    Path(folder, "python-control.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Verify, design, print and draw."""
    car = pf.examples.family("quarter-car-ride")
    print("regulator of one car, for every car:", pf.analyse(car, regulator(car), REGION).answer)
    K, poles = by_hand(car)
    print(f"by hand, one car: slowest pole {poles.real.max():.2f} 1/s")
    print("by hand, every car:", pf.worst_case(car, K, of="half_plane"))
    again = pf.from_control([pf.to_control(car, corner) for corner in np.eye(4)], disturbances=1)
    design = pf.place(again, pf.Disk(-40, 35), "slack")
    print(f"a list of four systems: proved, {design.certificate.prove().count} inequalities")
    draw(car, design, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
