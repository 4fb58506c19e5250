"""Arguments of other kinds than what is asked for: one line that names one, or an answer.

Every function and class of the package is called with each argument replaced by each of many things
that it is not. What comes back is an answer, or an error of the package's own, of one line.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, PolefenceError
from polefence.base.explained import explained, explained_fields
from polefence.examples import spec_text

R, V, F = pf.response, pf.vehicle, pf.fleet
GRID = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]  # rad/s
GAIN = [[-1.0, -1.0]]
NAN = float("nan")


class Stranger:
    """A type that nothing knows."""


def _hostile(plant, region):
    return {
        "None": None,
        "text": "x",
        "no text": "",
        "whole": 3,
        "negative": -1,
        "nan": NAN,
        "inf": float("inf"),
        "large": 10**400,
        "complex": 1j,
        "True": True,
        "bytes": b"x",
        "list": [],
        "ragged": [[1, 2], [3]],
        "row": [[0, 1]],
        "names": ["x"],
        "nothing in it": [None],
        "tuple": (1, 2, 3),
        "table": {"a": 1},
        "no table": {},
        "array": np.zeros((2, 3)),
        "array of nan": np.full((2, 2), NAN),
        "array of text": np.array(["a"]),
        "stranger": Stranger(),
        "function": lambda: 0,
        "plant": plant,
        "plants": [plant],
        "region": region,
    }


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wrong")
    for name, example in (("car", "quarter-car-m1"), ("ride", "quarter-car-ride"),
                          ("half", "half-car"), ("damper", "semi-active")):  # fmt: skip
        (folder / f"{name}.toml").write_text(spec_text(example))
    return folder


@pytest.fixture(scope="module")
def plant():
    p = pf.Parameter("k", 1, 2)
    return pf.UncertainPlant.from_expressions([p], [[0, 1], ["-k", -0.4]], [[0], [1]], E=[[0], [1]])


CALLS = (
    "Disk", "Ellipse", "HalfPlane", "Sector", "HorizontalStrip", "VerticalStrip", "Wedge",
    "EnergyPeak", "Gain", "GainNorm", "InitialPeak", "PeakToPeak", "RelativeRms", "Rms",
    "Saturation",
    "FixedGain", "GainTable", "PolynomialGain", "ScheduledGain", "Parameter", "System", "Scheduled",
    "Slack", "Structure", "UncertainPlant", "from_vertices", "from_expressions", "from_function",
    "analyse", "at_sample_time", "check", "closed_loops", "in_service", "from_control",
    "identify", "limits",
    "linearise", "load", "load_region", "load_specifications", "load_structure", "observe",
    "parse_region", "parse_specification", "place", "study", "tightest", "to_control",
    "with_actuator", "with_reference", "with_sensor", "with_weight", "worst_case", "z_plane",
    "many.place", "processes",
    "law.gain", "law.control", "design.poles", "design.save", "design.lyapunov_at", "Design.load",
    "plant.at", "plant.alpha", "step", "impulse", "frequency", "stationary", "weighted_sum",
    "states", "rate_of", "velocity_psd", "thirds", "Output", "bump", "kerb", "random_road",
    "roughness", "velocity_density", "displacement_density", "compare", "standard_laws", "points",
    "ride", "skyhook", "lqr", "comfort", "running_rms", "comfort_reading", "load_car",
    "load_dampers", "load_study", "export_c99", "check_guarantee",
)  # fmt: skip


@pytest.fixture(scope="module")
def calls(plant, here):
    """Calls that are right, by their names: function, arguments, keyword arguments."""
    region, car = pf.HalfPlane(0.5), pf.load(here / "car.toml")
    design = pf.place(plant, region)
    design.save(here / "d")
    signal = R.states(plant)[0]
    alpha = [[0.5, 0.5]]
    W = np.array([np.eye(2)] * 2)
    found = {
        "Disk": (pf.Disk, -40, 31),
        "Ellipse": (pf.Ellipse, -5, 2, 1),
        "HalfPlane": (pf.HalfPlane, 1),
        "Sector": (pf.Sector, 0.5),
        "HorizontalStrip": (pf.HorizontalStrip, 3),
        "VerticalStrip": (pf.VerticalStrip, -5, -1),
        "Wedge": (pf.Wedge, -1, 0.5),
        "EnergyPeak": (pf.EnergyPeak, "x1", {"norm": 1.0, "at_most": 2.0}),
        "Gain": (pf.Gain, "x1", {"at_most": 2.0}),
        "GainNorm": (pf.GainNorm, {"at_most": 5.0}),
        "InitialPeak": (pf.InitialPeak, "x1", {"points": ((1.0, 0.0),)}),
        "PeakToPeak": (pf.PeakToPeak, "x1", {"at_most": 2.0, "disturbances": {"w1": 0.5}}),
        "RelativeRms": (pf.RelativeRms, "x1", {"at_most": 0.5}),
        "Rms": (pf.Rms, "x1", {"density": 1.0, "at_most": 1.0, "weight": None}),
        "Saturation": (pf.Saturation, "u1", {"points": ((1.0, 0.0),)}),
        "FixedGain": (pf.FixedGain, GAIN),
        "GainTable": (pf.GainTable, plant.parameters, {"k": [1, 2]}, [GAIN, GAIN]),
        "PolynomialGain": (
            pf.PolynomialGain, ((0,), (1,)), np.array([GAIN, GAIN]), (), plant.parameters,
        ),
        "ScheduledGain": (pf.ScheduledGain, W, np.array([GAIN, GAIN]), plant.parameters),
        "Parameter": (pf.Parameter, "k", 1, 2, "N/m", "k", "label", (-1, 1)),
        "System": (pf.System, [[0, 1], [-1, -1]], [[0], [1]], [[0], [1]], "v"),
        "Scheduled": (pf.Scheduled, 1, 1, "simplex"),
        "Slack": (pf.Slack, 1, 0, "simplex"),
        "Structure": (pf.Structure, {"measured": ("x1",), "schedule": ("k",)}),
        "UncertainPlant": (
            pf.UncertainPlant, plant.vertices, plant.parameters, "p", ("a", "b"), ("u",), ("w",),
            None, (),
        ),
        "from_vertices": (
            pf.UncertainPlant.from_vertices, [[[0, 1], [-1, -1]]], [[[0], [1]]], [[[0], [1]]],
        ),
        "from_expressions": (
            pf.UncertainPlant.from_expressions, plant.parameters, [[0, 1], ["-k", -1]],
            [[0], [1]], [[0], [1]], {}, {}, {"y [m]": {"C": [1, 0]}},
        ),
        "from_function": (
            pf.UncertainPlant.from_function, lambda k: ([[0, 1], [-k, -1]], [[0], [1]]),
            plant.parameters,
        ),
        "analyse": (
            pf.analyse, plant, GAIN, region, {"limits": (pf.Rms("x1"),), "lyapunov": (W[0],)},
        ),
        "at_sample_time": (pf.at_sample_time, plant, 0.01, 1),
        "check": (pf.check, here / "d"),
        "closed_loops": (pf.closed_loops, plant, GAIN),
        "in_service": (pf.in_service, design),
        "from_control": (pf.from_control, pf.closed_loops(plant, GAIN, alpha=alpha)[0]),
        "identify": (
            pf.identify, [pf.data.FrequencyResponse(GRID, 1 / (1j * np.array(GRID) + 1))], 1, 0,
            {"inputs": ["u1"], "outputs": ["y1"], "direct": (), "name": "p"},
        ),
        "limits": (pf.limits, plant, [-3.0], ["quadratic"], {"bounds": False}),
        "linearise": (
            pf.linearise, lambda x, u, k: np.array([x[1], -k * x[0] + u[0]]), [0, 0], [0],
            plant.parameters,
        ),
        "load": (pf.load, here / "car.toml"),
        "load_region": (pf.load_region, here / "car.toml"),
        "load_specifications": (pf.load_specifications, here / "ride.toml"),
        "load_structure": (pf.load_structure, here / "ride.toml"),
        "observe": (pf.observe, plant, ["x1"], region),
        "parse_region": (pf.parse_region, "disk(-1, 1)"),
        "parse_specification": (pf.parse_specification, "peak gain of x1 <= 1"),
        "place": (pf.place, plant, region, "quadratic"),
        "study": (lambda *own: list(pf.study(*own)), here / "no.toml", here / "res"),
        "tightest": (pf.tightest, plant, -3.0),
        "to_control": (pf.to_control, plant, [0.5, 0.5]),
        "with_actuator": (pf.with_actuator, plant, "u1", 10.0),
        "with_reference": (pf.with_reference, plant, "r", "x1"),
        "with_sensor": (pf.with_sensor, plant, "x1", 10.0),
        "with_weight": (pf.with_weight, plant, "x1", "1/(s + 1)"),
        "worst_case": (pf.worst_case, plant, GAIN, "half_plane"),
        "z_plane": (pf.z_plane, region, 0.01),
        "many.place": (pf.many.place, [plant], region),
        "processes": (pf.processes, 1),
        "law.gain": (design.law.gain, [0.5, 0.5]),
        "law.control": (design.law.control, [0.5, 0.5], [1, 0]),
        "design.poles": (design.poles, alpha),
        "design.save": (design.save, here / "e"),
        "design.lyapunov_at": (design.lyapunov_at, [0.5, 0.5], 0),
        "Design.load": (pf.Design.load, here / "d"),
        "plant.at": (plant.at, [0.5, 0.5]),
        "plant.alpha": (plant.alpha, {"k": 1.5}),
        "step": (R.step, plant, GAIN, alpha, [signal]),
        "impulse": (R.impulse, plant, GAIN, alpha, [signal]),
        "frequency": (R.frequency, plant, GAIN, alpha, [1.0], [signal]),
        "stationary": (R.stationary, plant, GAIN, alpha, 1.0),
        "weighted_sum": (R.weighted_sum, "s", "m", [(1, signal)]),
        "states": (R.states, plant),
        "rate_of": (R.rate_of, plant, "x1"),
        "velocity_psd": (R.velocity_psd, 1e-6, 20.0),
        "thirds": (R.thirds, 1, 80),
        "Output": (R.Output, "y", "m", {"C": [[1, 0]]}),
        "bump": (V.bump, 0.05, 0.5, 20.0),
        "kerb": (V.kerb, 0.1, 10.0),
        "random_road": (V.random_road, "C", 100.0, 1),
        "roughness": (V.roughness, "C"),
        "velocity_density": (V.velocity_density, "C", 20.0),
        "displacement_density": (V.displacement_density, "C", 0.1),
        "compare": (V.compare, car, {"passive": None}, "C", 20.0),
        "standard_laws": (V.standard_laws, car, (-40, 36), ("passive",)),
        "points": (V.points, plant),
        "ride": (V.ride, car),
        "skyhook": (V.skyhook, car),
        "lqr": (V.lqr, car),
        "comfort": (V.comfort, np.zeros(300), 0.005),
        "running_rms": (V.running_rms, np.zeros(300), 0.005),
        "comfort_reading": (V.comfort_reading, 0.5),
        "load_car": (V.load_car, here / "half.toml"),
        "load_dampers": (V.load_dampers, here / "damper.toml"),
        "load_study": (F.load_study, here / "car.toml"),
        "export_c99": (pf.export.export_c99, design),
        "check_guarantee": (pf.export.check_guarantee, here / "no.json"),
    }  # fmt: skip
    assert tuple(found) == CALLS
    return found


def _fault(function, given, named):
    """What is wrong with what comes back; None where it is an answer, or refused in one line."""
    try:
        repr(function(*given, **named))
    except PolefenceError as error:
        text = str(error)
        return None if text and "\n" not in text and len(text) <= 750 else f"no line: {text[:200]}"
    except Exception as error:  # whatever it is: that is the fault
        return f"{type(error).__name__}: {error}"
    return None


@pytest.mark.parametrize("name", CALLS)
def test_no_wrong_argument_ends_in_an_error_of_python(calls, name, plant, here, monkeypatch):
    monkeypatch.chdir(here)  # where a text that is taken for a path may be written
    function, *given = calls[name]
    named = given.pop() if given and isinstance(given[-1], dict) and name not in LAST else {}
    faults = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy, on the way to an error
        for what, value in _hostile(plant, pf.HalfPlane(0.5)).items():
            for k in range(len(given)):
                fault = _fault(function, [*given[:k], value, *given[k + 1 :]], named)
                faults += [f"argument {k + 1} = {what}: {fault}"] if fault else []
            for key in named:
                fault = _fault(function, given, named | {key: value})
                faults += [f"{key} = {what}: {fault}"] if fault else []
    assert not faults


LAST = ("from_expressions",)  # whose last argument is a table itself


def test_a_right_call_answers(calls):
    """Else nothing above would be about its arguments."""
    refused = ("study", "load_study", "check_guarantee", "parse_specification")
    for name, (function, *given) in calls.items():
        named = given.pop() if given and isinstance(given[-1], dict) and name not in LAST else {}
        if name not in refused:
            function(*given, **named)


def test_the_line_names_the_argument_and_a_remedy():
    with pytest.raises(InputError) as caught:
        pf.UncertainPlant([[0, 1]], [[1]])
    assert str(caught.value) == (
        "UncertainPlant: vertices must be a sequence, each entry of type System, not a list of "
        "other values; UncertainPlant.from_vertices(As, Bs) takes matrices"
    )
    named = "^limits: plant must be of type UncertainPlant, not 'x'; polefence.load"
    with pytest.raises(InputError, match=named):
        pf.limits("x", -40)


def test_an_error_of_ours_stays_what_it_is():
    @explained
    def broken(count: int, name: str = "") -> int:
        return [count][count]  # our fault, whatever count is

    class Broken:
        count: int

        @explained_fields
        def __post_init__(self):
            raise KeyError("ours")

    with pytest.raises(IndexError):
        broken(3)
    with pytest.raises(InputError, match="count must be a whole number, not 'three'; give one"):
        broken("three")
    with pytest.raises(TypeError, match="unexpected keyword"):
        broken(3, other=1)
    own = Broken()
    own.count = 1
    with pytest.raises(KeyError, match="ours"):
        own.__post_init__()
