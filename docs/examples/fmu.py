"""The quarter car's law as a functional mock-up unit, in the loop with two cars; figure.

``python docs/examples/fmu.py [FOLDER]`` prints the page's numbers and writes fmu.png into the
folder, by default here. It needs a C compiler, cc, and fmpy, and takes some ten seconds.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import polefence as pf
from polefence.response.discrete import zero_order_hold

PERIOD, FINE = 0.001, 10  # [s]; steps of the car in a step of the unit
STEPS = 800  # of the unit, in a drive
SAMPLING = pf.export.Sampling(PERIOD, delay=1)
KINDS = ("float64", "float32", "wrong load")
LOADS = {240: "#2166ac", 340: "#b2182b"}  # of two cars [kg]


def exported():
    """Design, its law in double precision with the sample time, and in single without."""
    design = pf.place(pf.examples.family("quarter-car-physical"), pf.Disk(-40, 31), "scheduled")
    codes = {
        "float64": pf.export.export_c99(design, 64, sampling=SAMPLING),
        "float32": pf.export.export_c99(design, 32),
    }
    try:
        units = {
            name: pf.export.with_fmus(code, ["2.0"], step=PERIOD) for name, code in codes.items()
        }
    except pf.InputError as problem:  # no compiler
        raise SystemExit(str(problem)) from None
    return design, units


class Unit:
    """An FMU of an export, extracted and instantiated by fmpy."""

    def __init__(self, code, folder):
        try:
            import fmpy
            from fmpy.fmi2 import FMU2Slave
        except ImportError:
            raise SystemExit("fmpy is not found: pip install fmpy") from None
        Path(folder).mkdir(exist_ok=True)
        path = Path(folder, "law.fmu")
        path.write_bytes(code.files["law_fmi2.fmu"])
        about = fmpy.read_model_description(str(path))
        self.numbers = {own.name: own.valueReference for own in about.modelVariables}
        self.slave = FMU2Slave(
            guid=about.guid,
            unzipDirectory=fmpy.extract(str(path), str(Path(folder, "law"))),
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName="law",
        )

    def __enter__(self):
        self.slave.instantiate()
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def __exit__(self, *_):
        self.slave.terminate()
        self.slave.freeInstance()

    def step(self, time, inputs):
        """Set inputs by their names, step, return the force."""
        numbers = [self.numbers[name] for name in inputs]
        self.slave.setReal(numbers, [float(value) for value in inputs.values()])
        self.slave.doStep(currentCommunicationPoint=time, communicationStepSize=PERIOD)
        return self.slave.getReal([self.numbers["actuator_force"]])[0]


def road(plant):
    """A hole of 12 mm, half a metre long, at 10 m/s."""
    hole, step = pf.vehicle.pothole(0.012, 0.5), PERIOD / FINE
    return pf.vehicle.on_road(plant, hole, 10, step, STEPS * PERIOD)


def looped(plant, load, unit, told=None):
    """Drive a car with a unit; return x and the force on the car, at the unit's steps.

    A master that exchanges signals at the steps alone: while the unit goes from t to t + h, so
    does the car, with the force that the unit gave for its state a step ago.

    Parameters
    ----------
    told : float, optional
        The load that the unit is told [kg]; the true one by default.
    """
    names = ["suspension_deflection", "tyre_deflection", "sprung_mass_velocity"]
    names += ["unsprung_mass_velocity", "integral_of_suspension_deflection"]
    A, B = plant.at(plant.alpha(m1=load, beta=0))
    E = plant.vertices[0].E  # the same for every car
    step, enter = zero_order_hold(A, np.hstack([B, E]), PERIOD / FINE)
    x, force, states, forces = np.zeros(5), 0.0, [], []
    for k, own in enumerate(road(plant).w.reshape(STEPS, FINE)):
        states.append(x)
        forces.append(force)
        inputs = dict(zip(names, x, strict=True)) | {"m1": told or load, "beta": 0}
        after = unit.step(k * PERIOD, inputs)
        for w in own:
            x = step @ x + enter @ [force, w]
        force = after
    return np.array(states), np.array(forces)


def drive(design, load):
    """Return polefence's own drive of the sampled law: x and the force, at the samples."""
    parts = pf.vehicle.Hardware(sampling=SAMPLING)
    values = {"m1": load, "beta": 0}
    found = pf.vehicle.drive(design.plant, design.law, road(design.plant), values, parts)
    return found.states[0, :-1:FINE], found.demanded[0, :-1:FINE, 0]


def off(one, other):
    """Return how far drives differ over time: the worst signal, relative to its peak."""
    found = [np.abs(a - b) / np.abs(b).max(axis=0) for a, b in zip(one, other, strict=True)]
    return np.maximum(found[0].max(axis=1), found[1])


def draw(drives, found, folder):
    """Draw the forces, and how far the units' drives are from polefence's."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 3.8)
    time = PERIOD * np.arange(STEPS)
    for load, (_, force) in drives.items():
        left.plot(time, force, color=LOADS[load], lw=1.1, label=f"{load} kg, polefence")
        own = {"ls": "", "marker": "o", "ms": 3.4, "mfc": "none", "mew": 0.9}
        with_unit = found[load, "float64"][1][::8]
        left.plot(time[::8], with_unit, color=LOADS[load], **own, label=f"{load} kg, FMU")
    left.set(xlabel="time [s]", ylabel="actuator force [N]", title="force over the hole")
    left.legend(fontsize=8.5)
    heavy = max(drives)
    for kind, label, colour in (
        ("wrong load", f"FMU told {min(drives)} kg", "0.6"),
        ("float32", "FMU in float32", "#1b7837"),
        ("float64", "FMU in float64", "black"),
    ):
        own = off(found[heavy, kind], drives[heavy])
        right.semilogy(time[own > 0], own[own > 0], color=colour, lw=1.1, label=label)
    right.set(xlabel="time [s]", ylabel="difference / peak of the signal", ylim=(1e-17, 1e1))
    right.set_title(f"drive with the FMU less polefence's, {heavy} kg")
    right.legend(fontsize=8.5, loc="lower left")
    for ax in (left, right):
        ax.set_xlim(0, PERIOD * STEPS)
    Path(folder, "fmu.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Export, drive with the units and without, compare, print and draw."""
    design, units = exported()
    print("\n".join(units["float64"].texts.statement))
    drives, found = {load: drive(design, load) for load in LOADS}, {}
    with TemporaryDirectory() as place:
        for name, code in units.items():
            with Unit(code, Path(place, name)) as unit:
                for load in LOADS:
                    found[load, name] = looped(design.plant, load, unit)
        with Unit(units["float64"], Path(place, "wrong")) as unit:
            for load, told in zip(LOADS, reversed(LOADS), strict=True):
                found[load, "wrong load"] = looped(design.plant, load, unit, told)
    print("load     peak of force   off by, float64   float32   told the other load")
    for load, (_, force) in drives.items():
        numbers = [off(found[load, kind], drives[load]).max() for kind in KINDS]
        one, two = (f"{number:.0e}" for number in numbers[:2])
        wrong = f"{100 * numbers[2]:.0f} %"
        print(f"{load} kg {np.abs(force).max():13.0f} N {one:>17} {two:>9} {wrong:>21}")
    draw(drives, found, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
