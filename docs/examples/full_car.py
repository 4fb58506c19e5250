"""A full car with a skyhook damper at each corner: a given law, verified; figure.

``python docs/examples/full_car.py [FOLDER]`` prints the page's numbers and writes full-car.png
into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

SPEC = pf.examples.spec_path("full-car")
DENSITY = pf.vehicle.velocity_density("C", 20)  # road of class C at 20 m/s
REGION = pf.parse_region("half_plane(5) & sector(0.3)")
LIMIT = pf.Rms("driver acceleration", at_most=1.25, density=DENSITY)
DAMPING = 2000  # of each skyhook damper [N s/m]
SAMPLED = {"driver acceleration": "m/s2", "roll acceleration": "rad/s2"}
STYLES = {"passive": ("#e08214", "s"), "skyhook": ("#2166ac", "o")}


def skyhook(plant):
    """Force at each corner: minus DAMPING times the body's velocity there, as a gain."""
    K = np.zeros((4, 14))
    heave = plant.states.index("heave rate [m/s]")  # rates of pitch and roll behind it
    for force, (x, y) in zip(K, pf.vehicle.load_car(SPEC).places.values(), strict=True):
        force[heave : heave + 3] = [-DAMPING, DAMPING * float(x), -DAMPING * float(y)]
    return K


def cars(plant, count=300):
    """Random cars: loads [kg], and weights of the vertices for load and age."""
    random = np.random.default_rng(0)
    empty, most = map(float, (plant.parameters[0].low, plant.parameters[0].high))
    felt, age = random.uniform(empty, most, count), random.uniform(-0.1, 0.1, count)
    alpha = [plant.alpha(felt=m, age=a) for m, a in zip(felt, age, strict=True)]
    return felt - empty, np.array(alpha)


def draw(plant, laws, level, folder):
    """Draw poles and rms values of random cars, with what is proved of the law."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 3.8)
    load, alpha = cars(plant)
    A, B = plant.at(alpha)
    for name, K in laws.items():
        colour, marker = STYLES[name]
        poles = np.linalg.eigvals(A + B @ K).ravel()
        poles = poles[poles.imag >= 0]
        left.plot(poles.real, poles.imag, ".", ms=2, color=colour, label=name, rasterized=True)
        rms = pf.response.stationary(plant, K, alpha, DENSITY, ["driver acceleration"]).rms
        right.plot(load, rms, marker, ms=2.5, color=colour, label=name)
    slope = np.sqrt(1 - 0.3**2) / 0.3
    bound = {"color": "#b2182b", "ls": "--", "lw": 1.2}
    left.plot([-30, -5, -5], [30 * slope, 5 * slope, 0], label="region", **bound)
    left.set(xlim=(-32, 0), ylim=(0, 90), xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
    left.set_title("poles, and the region that is asked for")
    left.legend(fontsize=8.5, markerscale=4)
    right.axhline(level, label="skyhook, proved", **bound)
    right.set(xlabel="load on the rear seats [kg]", ylabel="rms [m/s²]", ylim=(1.02, 1.4))
    right.set_title("driver's acceleration")
    right.legend(fontsize=8.5)
    Path(folder, "full-car.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Verify, sample, print and draw."""
    plant = pf.load(SPEC)
    laws = {"passive": np.zeros((4, 14)), "skyhook": skyhook(plant)}
    print("passive:", pf.analyse(plant, laws["passive"], REGION).reason)
    found = pf.analyse(plant, laws["skyhook"], REGION, limits=[LIMIT])
    level = found.bounds[0].bound.level
    print(f"skyhook: {REGION} {found.kept}")
    print(f"skyhook: {LIMIT.title} at most {level:.3f} m/s2, proved")
    alpha = np.vstack([np.eye(4), cars(plant)[1]])
    for name, K in laws.items():
        decay, damping = (
            pf.worst_case(plant, K, of=own).region for own in ("half_plane", "sector")
        )
        print(
            f"{name}: decay rate {float(decay.decay):.3f} 1/s and damping ratio "
            f"{float(damping.damping):.4f} proved"
        )
        rms = pf.response.stationary(plant, K, alpha, DENSITY, list(SAMPLED)).rms.max(axis=0)
        for most, (own, unit) in zip(rms, SAMPLED.items(), strict=True):
            print(f"{name}: rms of {own} {most:.3f} {unit} in the worst of {len(alpha)} cars")
    draw(plant, laws, level, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
