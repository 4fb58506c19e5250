"""Cart and pole: a nonlinear plant linearised, a law proved, twenty nonlinear carts; figure.

``python docs/examples/cart_pole.py [FOLDER]`` prints the page's numbers and writes cart-pole.png
and cart-pole-poles.png into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import polefence as pf
from polefence.base.files import write_bytes
from polefence.show.plots import new_figure, poles_figure, render, sampled

G = 9.81  # [m/s2]
REGION = pf.parse_region("half_plane(1) & sector(0.6) & disk(-20, 20)")
BOX = (
    pf.Parameter("m", "0.1", "0.3", "kg"),
    pf.Parameter("l", "0.3", "0.7", "m", through="1/l"),
)
NAMES = {
    "name": "cart and pole",
    "states": ("cart [m]", "speed [m/s]", "angle [rad]", "rate [rad/s]"),
    "inputs": ("force [N]",),
}


def rates(x, u, m, l, M=1.0):  # noqa: E741
    """A point mass m on a rod of length l upon a cart of 1 kg, with a force on the cart."""
    _, v, angle, rate = x
    s, c = np.sin(angle), np.cos(angle)
    total = M + m * s**2
    a = (u[0] + m * s * (l * rate**2 - G * c)) / total
    return [v, a, rate, (G * s - a * c) / l]


def linearised(through="1/l"):
    """The family upright; its Jacobians are multi-affine in m and 1/l, not in m and l."""
    box = (BOX[0], pf.Parameter("l", "0.3", "0.7", "m", through=through))
    return pf.linearise(rates, np.zeros(4), [0], box, declared=through == "1/l", **NAMES)


def swings(law, count, angle):
    """Angles of so many random carts that start upright but for an angle [rad], over time."""
    random, time = np.random.default_rng(0), np.linspace(0, 5, 501)
    found = []
    for _ in range(count):
        m, l = (random.uniform(float(p.low), float(p.high)) for p in BOX)  # noqa: E741
        x0 = [0, 0, angle, 0]

        def closed(_t, x, m=m, l=l):  # noqa: E741
            return rates(x, law.K @ x, m, l)

        done = solve_ivp(closed, (0, time[-1]), x0, t_eval=time, rtol=1e-8, atol=1e-10)
        found.append(np.degrees(done.y[2]))
    return time, np.array(found)


def draw(design, folder):
    """Draw poles over the family, and twenty nonlinear carts from two angles."""
    poles = poles_figure({"cart and pole": sampled(design)}, design.region)
    write_bytes(Path(folder) / "cart-pole-poles.png", render(poles, "png"))
    figure, (left, right) = new_figure(2, 9.5, 3.3)
    for ax, angle in ((left, 10), (right, 40)):
        time, found = swings(design.law, 20, np.radians(angle))
        ax.plot(time, found.T, color="#2166ac", lw=0.7)
        ax.set(xlabel="time [s]", ylabel="angle [degrees]", title=f"from {angle} degrees")
        ax.margins(x=0)
    write_bytes(Path(folder) / "cart-pole.png", render(figure, "png"))


if __name__ == "__main__":
    for through in ("l", "1/l"):
        print(linearised(through))
    design = pf.place(linearised().plant, REGION, "quadratic")
    print(pf.check(design.save(sys.argv[1] if len(sys.argv) > 1 else ".")))
    print("K =", design.law.K)
    draw(design, sys.argv[1] if len(sys.argv) > 1 else ".")
