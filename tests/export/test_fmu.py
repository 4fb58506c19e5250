"""FMUs, run by fmpy: the same u as the law in Python, and what the standard asks of them."""

import ctypes
import io
import os
import re
import shutil
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence import Disk, FixedGain, place
from polefence.base.errors import InputError
from polefence.export import fmu as shared_library
from polefence.export.fmu import fmu, plain, platform, split, unique
from polefence.export.program import number, program
from polefence.export.sources import Texts
from polefence.response.discrete import Sampling, zero_order_hold
from support.drives import drive
from support.fixed_points import WordCode
from support.fixed_points import exported as in_words
from support.memories import CORNER, TIME, exported
from support.needed import absent, need

BOTH = pytest.mark.parametrize("version", ["2.0", "3.0"])
KINDS = ("parameters", "alpha", "fixed", "limited")
STRICT = [
    "-std=c99",
    "-O2",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wshadow",
    "-Wconversion",
    "-Werror",
]
STEP, SAMPLES = 5e-4, 1001  # [s] of the loop
CAR = {"m1": 260.0, "beta": 4.0}
HOSTILE = (
    '<&"\'>]]>\n{{ x }} */ "',
    "Fläche 😀\x00\x1f\ud800",
    "",
    "9 a",
    "9 A",
    "a [m]",
    "a [kg]",
)


@pytest.fixture(scope="module")
def compiler():
    return need("cc")


@pytest.fixture(scope="module")
def fmpy():
    try:
        import fmpy
    except ImportError:
        absent("fmpy")
    return fmpy


@pytest.fixture(scope="module")
def design(physical):
    return place(physical, Disk(-40, 31), "scheduled")


@pytest.fixture(scope="module")
def laws(design, small_designs):
    """Laws, their programs' parameters and texts."""
    plant, small = design.plant, small_designs["scheduled"]
    car = Texts("law", plant.name, ("Proved.",), plant.states, plant.inputs)
    two = Texts("two", "random", ("Proved.",), ("x1", "x2"), ("u1", "u2"))
    return {
        "parameters": (design.law, plant.parameters, car),
        "alpha": (small.law, (), two),
        "fixed": (FixedGain([[1.5, -2.0], [0.1, 3.0]]), (), two),
        "limited": (design.law, plant.parameters, replace(car, limits=(100.0,))),
    }


@pytest.fixture(scope="module")
def built(laws, compiler, tmp_path_factory):
    """Return the path of an FMU, built once."""
    folder, made = tmp_path_factory.mktemp("fmu"), {}

    def build(kind: str, version: str, bits: int = 64) -> Path:
        path = folder / f"{kind}-{version[0]}-{bits}.fmu"
        if path not in made:
            law, parameters, texts = laws[kind]
            content = fmu(program(law, parameters, number(bits)), texts, version=version, step=5e-4)
            path.write_bytes(content)
            made[path] = path
        return path

    return build


class Running:
    """An FMU of either version, by the names of its variables."""

    def __init__(self, fmpy, path: Path, folder: Path, name: str = "one") -> None:
        self.about = fmpy.read_model_description(str(path))
        if not (folder / "modelDescription.xml").exists():
            fmpy.extract(str(path), str(folder))
        self.old = self.about.fmiVersion == "2.0"
        self.messages = []
        slave = fmpy.fmi2.FMU2Slave if self.old else fmpy.fmi3.FMU3Slave
        self.raw = slave(
            guid=self.about.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.about.coSimulation.modelIdentifier,
            instanceName=name,
        )
        if self.old:
            self.callbacks = fmpy.fmi2.fmi2CallbackFunctions()
            self.callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(
                lambda _, name, status, category, text: self.messages.append(text.decode())
            )
            self.raw.instantiate(callbacks=self.callbacks)
        else:
            self.raw.instantiate(
                logMessage=lambda _, status, category, text: self.messages.append(text.decode())
            )
        self.references = {v.name: v.valueReference for v in self.about.modelVariables}
        self.inputs = [v.name for v in self.about.modelVariables if v.causality == "input"]
        self.outputs = [v.name for v in self.about.modelVariables if v.causality == "output"][:-1]

    def initialise(self, start: float = 0.0) -> None:
        if self.old:
            self.raw.setupExperiment(startTime=start)
            self.raw.enterInitializationMode()
        else:
            self.raw.enterInitializationMode(startTime=start)

    def begin(self, start: float = 0.0):
        self.initialise(start)
        self.raw.exitInitializationMode()
        return self

    def set(self, *values: float) -> None:
        """Set the first inputs."""
        references = [self.references[name] for name in self.inputs[: len(values)]]
        (self.raw.setReal if self.old else self.raw.setFloat64)(references, list(values))

    def real(self, *names: str) -> np.ndarray:
        references = [self.references[name] for name in names]
        return np.array((self.raw.getReal if self.old else self.raw.getFloat64)(references))

    @property
    def u(self) -> np.ndarray:
        return self.real(*self.outputs)

    @property
    def flags(self) -> int:
        get = self.raw.getInteger if self.old else self.raw.getUInt32
        return get([self.references["flags"]])[0]

    @property
    def time(self) -> float:
        return self.raw.getRealStatus(2) if self.old else self.real("time")[0]

    def step(self, start: float, length: float):
        return self.raw.doStep(currentCommunicationPoint=start, communicationStepSize=length)

    def close(self) -> None:
        self.raw.freeInstance()


@pytest.fixture
def run(fmpy, built, tmp_path):
    running = []

    def start(kind: str, version: str, bits: int = 64, name: str = "one") -> Running:
        folder = tmp_path / f"{kind}-{version}-{bits}"
        running.append(Running(fmpy, built(kind, version, bits), folder, name))
        return running[-1]

    yield start
    for each in running:
        each.close()


def expected(laws, kind: str, random) -> tuple[list[float], np.ndarray]:
    """Return random inputs of an FMU, and u by the law in Python."""
    law, parameters, texts = laws[kind]
    x = random.normal(size=len(texts.states))
    if kind == "fixed":
        return list(x), law.K @ x
    if kind == "alpha":
        alpha = random.dirichlet(np.ones(law.domain.corners))
        return [*x, *alpha], law.gain(alpha) @ x
    values = {p.name: random.uniform(float(p.low), float(p.high)) for p in parameters}
    u = law.gain_at(**values) @ x
    if kind == "limited":
        u = np.clip(u, -100, 100)
    return [*x, *values.values()], u


@BOTH
@pytest.mark.parametrize("kind", KINDS)
def test_valid_and_equal_to_python(run, built, laws, version, kind) -> None:
    from fmpy.validation import validate_fmu

    random = np.random.default_rng(3)
    assert validate_fmu(str(built(kind, version))) == []
    running = run(kind, version).begin()
    for k in range(20):
        inputs, u = expected(laws, kind, random)
        running.set(*inputs)
        running.step(k * 0.1, 0.1)
        np.testing.assert_allclose(running.u, u, rtol=1e-11, atol=1e-11 * np.abs(u).max())
        assert running.flags == (8 if kind == "limited" and np.any(np.abs(u) == 100) else 0)


@BOTH
def test_variables_and_structure(fmpy, built, version) -> None:
    about = fmpy.read_model_description(str(built("parameters", version)))
    found = [(v.name, v.unit, v.start, v.causality) for v in about.modelVariables]
    time = [("time", None, None, "independent")]
    assert found == (time if version == "3.0" else []) + [
        ("suspension_deflection", "m", "0.0", "input"),
        ("tyre_deflection", "m", "0.0", "input"),
        ("sprung_mass_velocity", "m/s", "0.0", "input"),
        ("unsprung_mass_velocity", "m/s", "0.0", "input"),
        ("integral_of_suspension_deflection", "m s", "0.0", "input"),
        ("m1", "kg", "288.9", "input"),
        ("beta", None, "0.0", "input"),
        ("actuator_force", "N", None, "output"),
        ("flags", None, None, "output"),
    ]
    assert [u.name for u in about.unitDefinitions] == ["N", "kg", "m", "m s", "m/s"]
    inputs = [v for v in about.modelVariables if v.causality == "input"]
    for unknowns in (about.outputs, about.initialUnknowns):
        assert [u.variable.name for u in unknowns] == ["actuator_force", "flags"]
        assert all(u.dependencies == inputs for u in unknowns)
    assert float(about.defaultExperiment.stepSize) == 5e-4
    assert about.description == "Proved."
    sources = about.buildConfigurations[0].sourceFileSets[0].sourceFiles
    assert sources == ["law.c", f"law_fmi{version[0]}.c"]


@BOTH
def test_a_fault_in_the_description_is_found(built, version, tmp_path) -> None:
    from fmpy.validation import validate_fmu

    path = tmp_path / "broken.fmu"
    with zipfile.ZipFile(built("fixed", version)) as old, zipfile.ZipFile(path, "w") as new:
        new.writestr(
            "modelDescription.xml",
            old.read("modelDescription.xml").replace(b'name="x2"', b'name="x1"'),
        )
    assert validate_fmu(str(path)) != []


def test_alpha_begins_at_equal_weights(run, laws) -> None:
    running = run("alpha", "2.0")
    assert running.inputs == ["x1", "x2", "alpha_1", "alpha_2", "alpha_3"]
    running.begin().set(1.0, -2.0)
    law = laws["alpha"][0]
    np.testing.assert_allclose(running.u, law.gain([1 / 3] * 3) @ [1.0, -2.0], rtol=1e-11)


@BOTH
def test_u_is_that_of_the_inputs_as_they_are(run, design, version) -> None:
    running = run("parameters", version)
    x = [0.01, -0.002, 0.3, 0.1, 0.004]
    running.initialise(start=2.0)
    running.set(*x)
    middle = design.law.gain_at(m1=288.9, beta=0) @ x
    np.testing.assert_allclose(running.u, middle, rtol=1e-10)  # in initialisation
    running.raw.exitInitializationMode()
    running.set(*x, *CAR.values())
    np.testing.assert_allclose(running.u, design.law.gain_at(**CAR) @ x, rtol=1e-10)
    running.set(*x, 288.9, 0)
    reached = running.step(2.0, 0.25)
    np.testing.assert_allclose(running.u, middle, rtol=1e-10)
    assert running.time == 2.25
    if version == "3.0":
        assert reached == (False, False, False, 2.25)
    assert list(running.real(*running.inputs)) == [*x, 288.9, 0]


@BOTH
@pytest.mark.parametrize("bits", [32, 64])
def test_flags_of_what_is_outside(run, design, version, bits) -> None:
    running = run("parameters", version, bits).begin()
    x = [0.01, 0, 0, 0, 0]
    tolerance = 1e-4 if bits == 32 else 1e-10
    for m1, taken, flags in ((1e300, 346.68, 1), (-1e300, 231.12, 1), (np.nan, 288.9, 2)):
        running.set(*x, m1, 0.0)
        u = design.law.gain_at(m1=taken, beta=0) @ x
        np.testing.assert_allclose(running.u, u, rtol=tolerance)
        assert running.flags == flags
    for bad in (np.nan, np.inf, 1e300, -1e300):
        running.set(bad, 0, 0, 0, 0, 288.9, 0.0)
        if bits == 32 or not np.isfinite(bad):
            assert (list(running.u), running.flags) == ([0.0], 4)


@BOTH
def test_instances_share_nothing(run, design, version) -> None:
    one, two = (run("parameters", version, name=name).begin() for name in ("one", "two"))
    x = np.array([0.01, -0.002, 0.3, 0.1, 0.004])
    one.set(*x, *CAR.values())
    two.set(*-x, 300.0, -5.0)
    for first, second in ((one, two), (two, one)):
        first.step(0, 1)
        second.step(0, 1)
        np.testing.assert_allclose(one.u, design.law.gain_at(**CAR) @ x, rtol=1e-10)
        np.testing.assert_allclose(two.u, -design.law.gain_at(m1=300, beta=-5) @ x, rtol=1e-10)


@BOTH
def test_state_is_kept_put_back_and_serialised(fmpy, run, version) -> None:
    one, two = run("parameters", version).begin(), run("parameters", version, name="two")
    one.set(0.01, 0, 0, 0, 0, *CAR.values())
    one.step(0, 0.5)
    u, state = one.u, one.raw.getFMUState()
    one.set(-0.3, 0, 0, 0, 0, 300.0, 2.0)
    one.step(0.5, 0.5)
    assert one.u != u
    one.raw.setFMUState(state)
    assert one.u == u
    assert one.time == 0.5
    one.raw.setFMUState(state)  # it can be used again
    kept = one.raw.serializeFMUState(state)
    assert kept == one.raw.serializeFMUState(state)
    other = two.raw.deserializeFMUState(kept)
    two.raw.setFMUState(other)  # with it, into the mode of the first
    assert two.u == u
    two.step(0.5, 0.5)
    for each, own in ((one, state), (two, other)):
        each.raw.freeFMUState(own)
        assert not own.value
        each.raw.freeFMUState(own)  # no more to free
    for bad in (kept[:-1], kept + b"0", kept[:-1] + bytes([kept[-1] ^ 1]), bytes(len(kept))):
        with pytest.raises(Exception, match="failed with status 3"):
            one.raw.deserializeFMUState(bad)
    assert one.messages[-1].endswith("the bytes are no state of this FMU")
    assert one.u == u


@BOTH
def test_reset_begins_anew(run, design, version) -> None:
    running = run("parameters", version).begin(start=1.0)
    running.set(0.2, 0, 0, 0, 0, *CAR.values())
    running.step(1.0, 1.0)
    running.raw.terminate()
    assert running.u != 0
    running.raw.reset()
    running.begin()
    assert list(running.real(*running.inputs)) == [0, 0, 0, 0, 0, 288.9, 0]
    assert running.u == 0


@BOTH
def test_calls_out_of_place_are_refused(run, version) -> None:
    running = run("parameters", version)
    raw = running.raw

    def refused(call, message: str) -> None:
        with pytest.raises(Exception, match="failed with status 3"):
            call()
        assert running.messages.pop().endswith(message)

    mode = "not allowed in this mode"
    refused(lambda: running.step(0, 1), mode)
    refused(lambda: running.u, mode)
    refused(raw.exitInitializationMode, mode)
    refused(raw.terminate, mode)
    running.begin()
    refused(running.initialise, mode)
    reals = (raw.getReal, raw.setReal) if running.old else (raw.getFloat64, raw.setFloat64)
    for reference in (99, 2**32 - 1, running.references["flags"]):
        refused(lambda r=reference: reals[0]([r]), "a value reference is no real number")
    for reference in (99, 2**32 - 1, running.references["actuator_force"]):
        refused(lambda r=reference: reals[1]([r], [1.0]), "a value reference is no input")
    flags = raw.getInteger if running.old else raw.getUInt32
    refused(lambda: flags([running.references["m1"]]), "a value reference is not the flags")
    refused(lambda: raw.getBoolean([1]), "there is no variable of this type")
    raw.getBoolean([])
    refused(lambda: raw.getDirectionalDerivative([8], [1], [1.0]), "not offered by this FMU")
    for length in (-1.0, np.nan, np.inf):
        refused(lambda h=length: running.step(0, h), "the step is negative or no number")
    raw.terminate()
    refused(lambda: running.step(0, 1), mode)
    refused(lambda: running.set(1.0), mode)
    assert running.messages == []


@BOTH
def test_missing_pointers_are_refused(run, version) -> None:
    running = run("parameters", version).begin()
    raw, handle, one = running.raw, running.raw.component, (ctypes.c_uint * 1)(1)
    value, size = (ctypes.c_double * 1)(), ctypes.c_size_t()
    fmi, more = ("fmi2", ()) if running.old else ("fmi3", (1,))
    real, state = ("Real", "FMUstate") if running.old else ("Float64", "FMUState")
    call = {
        f"Get{real}": [(None, one, 1, value, *more), (handle, None, 1, value, *more),
                       (handle, one, 1, None, *more)],
        f"Set{real}": [(None, one, 1, value, *more), (handle, None, 1, value, *more),
                       (handle, one, 1, None, *more)],
        f"Get{state}": [(None, None), (handle, None)],
        f"Set{state}": [(None, None), (handle, None)],
        f"Serialized{state}Size": [(handle, None, ctypes.byref(size))],
        f"Serialize{state}": [(handle, None, None, 0)],
        "Terminate": [(None,)],
        "Reset": [(None,)],
    }  # fmt: skip
    for name, lists in call.items():
        function = getattr(raw.dll, fmi + name)
        function.restype = ctypes.c_int
        for arguments in lists:
            plain_arguments = [
                ctypes.c_void_p(a) if isinstance(a, int) and a == handle
                else ctypes.c_size_t(a) if isinstance(a, int) else a
                for a in arguments
            ]  # fmt: skip
            assert function(*plain_arguments) == 3, (name, arguments)
    getattr(raw.dll, f"{fmi}FreeInstance")(None)


@BOTH
def test_another_token_or_kind_gives_no_instance(fmpy, run, version) -> None:
    running = run("fixed", version)
    if running.old:
        callbacks = ctypes.byref(running.callbacks)
        start = running.raw.fmi2Instantiate
        assert start(b"a", 1, b"{another}", b"", callbacks, 0, 0) is None
        assert start(b"a", 0, running.about.guid.encode(), b"", callbacks, 0, 0) is None
        assert start(b"", 1, running.about.guid.encode(), b"", callbacks, 0, 0) is None
        assert len(running.messages) == 2
        return
    log, token = running.raw.logMessage, running.about.guid.encode()
    assert (
        running.raw.fmi3InstantiateModelExchange(b"a", token, b"", False, False, None, log) is None
    )
    for name, own, event_mode in (
        (b"a", b"another", False),
        (b"", token, False),
        (b"a", token, True),
    ):
        assert (
            running.raw.fmi3InstantiateCoSimulation(
                name, own, b"", False, False, event_mode, False, None, 0, None, log,
                running.raw.intermediateUpdate,
            )
            is None
        )  # fmt: skip
    assert len(running.messages) == 4


@pytest.fixture(params=["2.0", "3.0"])
def remembering(request, fmpy, compiler, tmp_path):
    """Two instances of a law with a state of its own, and its law's matrices at a corner."""
    from fmpy.validation import validate_fmu

    made, path = exported("affine", 64), tmp_path / "law.fmu"
    path.write_bytes(fmu(made.program, made.texts, version=request.param, step=TIME))
    assert validate_fmu(str(path)) == []
    running = [Running(fmpy, path, tmp_path / "law", name) for name in ("one", "two")]
    yield *running, made.design.law.own_gain(made.design.plant.alpha(**CORNER))
    for each in running:
        each.close()


def test_a_step_takes_the_laws_own_states_further(remembering) -> None:
    """u of inputs and states as they are; whole sample times; nothing is shared."""
    one, two, K = remembering
    one.initialise()
    two.begin().set(0.0, *CORNER.values())
    random, state, time = np.random.default_rng(4), 0.0, 0.0
    one.set(0.3, *CORNER.values())
    one.raw.exitInitializationMode()
    assert one.u[0] == pytest.approx(K[0, 0] * 0.3)
    for samples in (1, 1, 2, 1, 5, 0, 1):
        y = random.normal()
        one.set(y, *CORNER.values())
        assert one.u[0] == pytest.approx(K[0] @ [y, state])
        assert one.u[0] == pytest.approx(K[0] @ [y, state])  # looking takes nothing further
        one.step(time, samples * TIME)
        time += samples * TIME
        for _ in range(samples):
            state += TIME * K[1] @ [y, state]
        assert one.u[0] == pytest.approx(K[0] @ [y, state])
    assert two.u[0] == 0
    assert not one.about.coSimulation.canHandleVariableCommunicationStepSize
    for length in (0.5 * TIME, 1.01 * TIME, 1e300):
        with pytest.raises(Exception, match="failed with status 3"):
            one.step(time, length)
        assert one.messages.pop().endswith("a whole multiple of the law's sample time")
    assert one.u[0] == pytest.approx(K[0] @ [y, state])


def test_the_laws_own_states_are_kept_put_back_and_begin_anew(remembering) -> None:
    one, two, K = remembering
    one.begin().set(0.3, *CORNER.values())
    one.step(0, TIME)
    u, kept = one.u, one.raw.getFMUState()
    assert u[0] == pytest.approx(K[0] @ [0.3, TIME * K[1, 0] * 0.3])
    one.step(TIME, 3 * TIME)
    assert one.u != u
    one.raw.setFMUState(kept)
    assert one.u == u
    two.raw.setFMUState(two.raw.deserializeFMUState(one.raw.serializeFMUState(kept)))
    assert two.u == u
    one.raw.freeFMUState(kept)
    one.raw.terminate()
    one.raw.reset()
    one.begin().set(0.3, *CORNER.values())
    assert one.u[0] == pytest.approx(K[0, 0] * 0.3)


def road(samples: int, step: float) -> np.ndarray:
    """Velocity of a road that rises by 40 mm in 5 ms."""
    return np.where(np.arange(samples) * step < 0.005, 8.0, 0.0)


@pytest.fixture(scope="module")
def told(design):
    """Return the road's velocity, and the Python simulation of the sampled loop."""
    w = road(SAMPLES, STEP)
    return w, drive(
        design.plant, design.law, w, step=STEP, hold="held", parameters=CAR,
        sampling=Sampling(STEP),
    )  # fmt: skip


@BOTH
@pytest.mark.parametrize(("bits", "tolerance"), [(64, 1e-6), (32, 1e-4)])
def test_step_response_in_the_loop(run, design, told, version, bits, tolerance) -> None:
    """The exported code in a sampled loop, its plant in exact steps, against the simulation."""
    w, simulated = told
    A, B = design.plant.at(design.plant.alpha(**CAR))
    E = np.array([[0.0], [1.0], [0.0], [0.0], [0.0]])
    Phi, Gamma = zero_order_hold(A, np.hstack([B, E]), STEP)

    running = run("parameters", version, bits).begin()
    x, states, demands = np.zeros(5), [], []
    for k in range(SAMPLES):
        running.set(*x, *CAR.values())
        running.step(k * STEP, STEP)
        states.append(x)
        demands.append(running.u)
        x = Phi @ x + Gamma @ [*demands[-1], w[k]]
    for own, python in ((states, simulated.states), (demands, simulated.demanded)):
        python = python[0, :SAMPLES]
        size = np.abs(python).max(axis=0)
        assert np.all(size > 0)
        error = np.abs(own - python).max(axis=0) / size
        assert np.all(error < tolerance), error
        if bits == 32:  # it is the code in float32 that ran
            assert np.all(error > 1e-10)


@BOTH
def test_fmpy_simulates_it(fmpy, built, design, version) -> None:
    count, step = 50, 5e-4
    time = step * np.arange(count + 1)
    signals = np.zeros(
        count + 1, dtype=[("time", float), ("suspension_deflection", float), ("m1", float)]
    )
    signals["time"] = time
    signals["suspension_deflection"] = 0.01 * np.sin(200 * time)
    signals["m1"] = np.linspace(240, 330, count + 1)
    found = fmpy.simulate_fmu(
        str(built("parameters", version)), stop_time=time[-1], input=signals, output_interval=step,
        start_values={"beta": 3.0},
    )  # fmt: skip
    # what is read at the end of a step is u of the inputs at its beginning
    u = [
        design.law.gain_at(m1=m1, beta=3.0)[0, 0] * x
        for x, m1 in zip(signals["suspension_deflection"], signals["m1"], strict=True)
    ]
    np.testing.assert_allclose(found["actuator_force"][1:], u[:-1], rtol=1e-9, atol=1e-9)
    assert not found["flags"].any()


@BOTH
@pytest.mark.parametrize(("kind", "bits"), [*((kind, 64) for kind in KINDS), ("parameters", 32)])
def test_c_passes_strict_compilers(built, compiler, version, kind, bits, tmp_path) -> None:
    with zipfile.ZipFile(built(kind, version, bits)) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    strictly(compiler, sources, *sorted(path.name for path in sources.glob("*.c")))


def given_sources(monkeypatch, law, parameters, texts, version, bits=64) -> dict[str, str]:
    """Return the sources of an FMU without compiling them."""
    found = {}

    def library(sources, *_):
        found.update(sources)
        return "binaries/none", b""

    with monkeypatch.context() as patched:
        patched.setattr("polefence.export.fmu.library", library)
        content = fmu(program(law, parameters, number(bits)), texts, version=version)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        found["modelDescription.xml"] = archive.read("modelDescription.xml").decode()
    return found


def write(sources: dict[str, str], folder: str) -> None:
    for name, text in sources.items():
        Path(folder, name).write_text(text)


def strictly(compiler: str, folder: str, *arguments: str) -> None:
    done = subprocess.run(
        [compiler, *STRICT, "-fvisibility=hidden", "-c", *arguments],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def standard_headers(fmpy, version: str) -> tuple[Path, str]:
    folder = Path(fmpy.__file__).parent / "c-code"
    name = f"fmi{version[0]}Functions.h"
    if not (folder / name).exists():
        absent(f"fmpy's {name}")
    return folder, name


@BOTH
def test_definitions_fit_the_standards_headers(fmpy, laws, compiler, monkeypatch, version) -> None:
    headers, name = standard_headers(fmpy, version)
    sources = given_sources(monkeypatch, *laws["parameters"], version)
    own = f"law_fmi{version[0]}"
    code = sources[f"{own}.c"]
    with TemporaryDirectory() as folder:
        write(sources, folder)
        Path(folder, f"{own}.h").write_text(f'#include "{name}"\n')
        strictly(compiler, folder, f"-I{headers}", f"{own}.c")
        wrong = code.replace(
            "(fmi2Component instance, fmi2Real from", "(fmi2Component instance, float from"
        )
        wrong = wrong.replace(
            "(fmi3Instance instance, fmi3Float64 from", "(fmi3Instance instance, float from"
        )
        assert wrong != code
        Path(folder, f"{own}.c").write_text(wrong)
        with pytest.raises(AssertionError, match="conflicting types"):
            strictly(compiler, folder, f"-I{headers}", f"{own}.c")


@BOTH
def test_every_function_of_the_standard_and_no_other_is_exported(
    fmpy, built, version, tmp_path
) -> None:
    headers, name = standard_headers(fmpy, version)
    text = (headers / name).read_text()
    if version == "2.0":  # model exchange is not offered
        begin, end = (text.index(f"#define fmi2{n}") for n in ("EnterEvent", "SetRealInput"))
        text = text[:begin] + text[end:]
    asked = set(re.findall(r"^#define (fmi\d\w+) +fmi\dFullName", text, re.MULTILINE))
    assert len(asked) > 30
    with zipfile.ZipFile(built("parameters", version)) as archive:
        library = next(n for n in archive.namelist() if n.startswith("binaries/"))
        archive.extract(library, tmp_path)
    if shutil.which("nm") is None:
        absent("nm")
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", tmp_path / library],
        capture_output=True,
        text=True,
        check=True,
    )
    assert {line.split()[-1] for line in listed.stdout.splitlines()} == asked


@BOTH
def test_included_sources_make_the_included_library(
    fmpy, built, compiler, version, tmp_path
) -> None:
    path = built("parameters", version)
    fmpy.extract(str(path), str(tmp_path))
    names = (
        fmpy.read_model_description(str(path)).buildConfigurations[0].sourceFileSets[0].sourceFiles
    )
    sources = {f.name: f.read_text() for f in (tmp_path / "sources").iterdir()}
    assert set(names) == {name for name in sources if name.endswith(".c")}
    place, content = shared_library.library(
        {name: sources[name] for name in (*names, *sources)}, "law", version
    )
    assert (tmp_path / place).read_bytes() == content
    folder = "linux64" if version == "2.0" else "x86_64-linux"
    if (
        platform(subprocess.check_output([compiler, "-dumpmachine"], text=True), version)[0]
        == folder
    ):
        assert place == f"binaries/{folder}/law.so"


def test_same_design_gives_the_same_bytes(laws, built) -> None:
    law, parameters, texts = laws["parameters"]
    own = program(law, parameters, number(64))
    again = fmu(own, texts, version="3.0", step=5e-4)
    assert again == built("parameters", "3.0").read_bytes()
    times = {info.date_time for info in zipfile.ZipFile(io.BytesIO(again)).infolist()}
    assert times == {(1980, 1, 1, 0, 0, 0)}


def test_token_follows_the_content(laws, monkeypatch) -> None:
    law, parameters, texts = laws["parameters"]
    other = replace(law, Z=law.Z * (1 + 1e-15))
    told = replace(texts, statement=("Not proved.",))
    tokens = [
        re.search(r'instantiationToken="([^"]+)"', sources["modelDescription.xml"])[1]
        for sources in (
            given_sources(monkeypatch, law, parameters, texts, "3.0"),
            given_sources(monkeypatch, law, parameters, texts, "3.0"),
            given_sources(monkeypatch, other, parameters, texts, "3.0"),
            given_sources(monkeypatch, law, parameters, told, "3.0"),
            given_sources(monkeypatch, law, parameters, texts, "3.0", 32),
        )
    ]
    assert tokens[0] == tokens[1]
    assert len(set(tokens)) == 4


@BOTH
def test_hostile_texts(fmpy, compiler, version, tmp_path) -> None:
    from fmpy.validation import validate_fmu

    texts = Texts("fmi2", HOSTILE[0], HOSTILE[:2], HOSTILE, (HOSTILE[0], "X1"))
    law = FixedGain(np.arange(14.0).reshape(2, 7))
    path = tmp_path / "hostile.fmu"
    path.write_bytes(fmu(program(law, (), number(64)), texts, version=version))
    assert validate_fmu(str(path)) == []
    running = Running(fmpy, path, tmp_path / "open")
    about = running.about
    assert about.modelName == '<&"\'>]]> {{ x }} */ "'
    assert [v.description for v in about.modelVariables if v.causality == "input"] == [
        '<&"\'>]]> {{ x }} */ "', "Fläche 😀???", "", "9 a", "9 A",
        "a [m]", "a [kg]",
    ]  # fmt: skip
    assert running.inputs == ["x", "Fl_che", "x3", "x4_9_a", "x5_9_A", "a", "a_2"]
    assert running.outputs == ["x_2", "X1"]
    running.begin().set(*range(7))
    np.testing.assert_allclose(running.u, law.K @ np.arange(7))
    running.close()


@BOTH
@pytest.mark.parametrize(("kind", "bits"), [("own state", 16), ("square", 32), ("alpha", 16)])
def test_a_unit_of_integers_is_the_code_between_its_ports(
    fmpy, compiler, version, kind, bits, tmp_path
) -> None:
    from fmpy.validation import validate_fmu

    made = in_words(kind, bits)
    path = tmp_path / "law.fmu"
    path.write_bytes(fmu(made.program, made.texts, version=version, step=made.texts.sample_time))
    assert validate_fmu(str(path)) == []
    running, code = Running(fmpy, path, tmp_path / "open").begin(), WordCode(made, tmp_path)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    strictly(compiler, sources, *sorted(each.name for each in sources.glob("*.c")))
    scales, order = made.program.scales, 1 if kind == "own state" else 0
    n = len(scales.signals) - order
    shifts = [*scales.signals[:n], *(scales.given or [bits - 2] * (len(running.inputs) - n))]
    units = 2.0 ** np.array(shifts)
    low = [float(share.low) for share in getattr(made.program, "shares", ())]
    high = [float(share.high) for share in getattr(made.program, "shares", ())]
    random, top, own, time = np.random.default_rng(2), 2 ** (bits - 1) - 1, [0] * order, 0.0
    for k in range(40):
        x = random.uniform(-1.2, 1.2, n) * top / units[:n]
        given = random.uniform(low, high) if low else random.dirichlet(np.ones(len(units) - n))
        values = np.concatenate([x, given])
        running.set(*values)
        whole = [int(v) for v in np.clip(np.round(values * units), -top, top)]
        after, flags = code.update(whole[n:], whole[:n], own)
        beyond = 32 if np.any(np.abs(np.round(values * units)) > top) else 0
        assert running.u[0] == after[0] * 2.0 ** -scales.answers[0]
        assert running.flags == flags | beyond
        if order:
            if k == 20:
                state = running.raw.getFMUState()
                running.step(time, TIME)
                running.raw.setFMUState(state)
            running.step(time, TIME)
            own, time = after[1:], time + TIME
    running.set(np.nan)
    assert running.flags & 4
    running.close()


@BOTH
@pytest.mark.parametrize("kind", ["floats", "integers"])
def test_a_law_with_states_begins_where_it_answers_what_acted(
    fmpy, compiler, version, kind, tmp_path
) -> None:
    from fmpy.validation import validate_fmu

    made = exported("affine", 64) if kind == "floats" else in_words("own state", 16)
    path = tmp_path / "law.fmu"
    path.write_bytes(fmu(made.program, made.texts, version=version, step=TIME))
    assert validate_fmu(str(path)) == []
    asked, given = 3.0, (0.1, *CORNER.values())
    plain = Running(fmpy, path, tmp_path / "open").begin()
    plain.set(*given)
    unmoved = plain.u[0]
    running = Running(fmpy, path, tmp_path / "open", "two")
    assert {"acting_force", "begins_with_acting"} <= running.references.keys()
    references = [running.references[name] for name in ("acting_force", "begins_with_acting")]
    set_real = running.raw.setReal if running.old else running.raw.setFloat64
    running.initialise()
    running.set(*given)
    set_real(references, [asked, 1.0])
    near = 1e-12 if kind == "floats" else 0.01
    assert running.u[0] == pytest.approx(asked, abs=near)
    assert abs(unmoved - asked) > 0.1
    running.raw.exitInitializationMode()
    assert running.u[0] == pytest.approx(asked, abs=near)
    assert running.flags == 0
    assert list(running.real("acting_force", "begins_with_acting")) == [asked, 1.0]
    with pytest.raises(Exception, match="failed with status 3"):
        set_real(references, [0.0, 0.0])
    assert running.messages[-1].endswith("where the law begins is set before it does")
    running.step(0.0, TIME)
    plain.step(0.0, TIME)
    assert running.u[0] != plain.u[0]
    for each in (plain, running):
        each.close()


@given(st.text())
def test_any_text_fits_into_xml(text) -> None:
    shown = plain(text)
    assert "\n" not in shown
    tree = ElementTree.fromstring(f"<a b={quoteattr(shown)}/>")
    assert tree.attrib["b"] == shown


@given(st.lists(st.text(max_size=5), max_size=8))
def test_names_are_unique_identifiers(names) -> None:
    found = unique(names, [f"x{i + 1}" for i in range(len(names))], ("time", "flags"))
    assert all(re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name) for name in found)
    assert len({name.lower() for name in found} | {"time", "flags"}) == len(names) + 2


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("suspension deflection [m]", "suspension deflection", "m"),
        ("integral [m s] ", "integral", "m s"),
        ("angle [°]", "angle", "°"),
        ("v", "v", ""),
        ("v []", "v []", ""),
        ("v [ ]", "v [ ]", ""),
        ("v [<m>]", "v [<m>]", ""),
        ("v [m] and more", "v [m] and more", ""),
        ("a [m] b [kg/s^2]", "a [m] b", "kg/s^2"),
    ],
)
def test_units_of_names(text, name, unit) -> None:
    assert split(text) == (name, unit)


@pytest.mark.parametrize(
    ("target", "old", "new"),
    [
        ("x86_64-linux-gnu\n", ("linux64", "so"), ("x86_64-linux", "so")),
        ("x86_64-redhat-linux", ("linux64", "so"), ("x86_64-linux", "so")),
        ("i686-linux-gnu", ("linux32", "so"), ("x86-linux", "so")),
        ("aarch64-linux-gnu", ("linux64", "so"), ("aarch64-linux", "so")),
        ("armv7l-unknown-linux-gnueabihf", ("linux32", "so"), ("aarch32-linux", "so")),
        ("arm64-apple-darwin23.1.0", ("darwin64", "dylib"), ("aarch64-darwin", "dylib")),
        ("x86_64-apple-darwin20", ("darwin64", "dylib"), ("x86_64-darwin", "dylib")),
        ("x86_64-w64-mingw32", ("win64", "dll"), ("x86_64-windows", "dll")),
        ("i686-w64-mingw32", ("win32", "dll"), ("x86-windows", "dll")),
        ("x86_64-pc-windows-msvc", ("win64", "dll"), ("x86_64-windows", "dll")),
    ],
)
def test_places_of_libraries(target, old, new) -> None:
    assert platform(target, "2.0") == old
    assert platform(target, "3.0") == new


FAKE = "#!/bin/sh\n"
TARGET = FAKE + '[ "$1" = -dumpmachine ] && echo x86_64-linux-gnu && exit 0\n'


@pytest.mark.skipif(os.name != "posix", reason="the compilers of this test are shell scripts")
@pytest.mark.parametrize(
    ("script", "message"),
    [
        (None, "is not found; an FMU holds compiled C: install gcc"),
        ("\0", "is not found"),
        (FAKE + "echo arm-none-eabi", "the compiler builds for 'arm-none-eabi', where no FMU runs"),
        (FAKE, "the compiler builds for '', where no FMU runs"),
        (FAKE + "exit 3", r"failed \(exit 3\): no message; use gcc or clang"),
        (
            TARGET + "printf 'note\\nlaw.c:1: error: \\001bad\\n' >&2; exit 1",
            r"law.c:1: error: bad;",
        ),
        (TARGET + "exit 0", "reported success and wrote no library"),
        (TARGET + "exec sleep 20", "took more than 0.5 s"),
        ("\x7fELF nonsense", "cannot be started: Exec format error"),
    ],
)
def test_compilers_that_make_nothing(laws, monkeypatch, tmp_path, script, message) -> None:
    law, parameters, texts = laws["fixed"]
    own = tmp_path / "cc"
    if script is not None and script != "\0":
        own.write_text(script)
        own.chmod(0o755)
    monkeypatch.setattr(shared_library, "TIMEOUT", 0.5)
    name = "a\0b" if script == "\0" else str(own)
    with pytest.raises(InputError, match=message) as caught:
        fmu(program(law, parameters, number(64)), texts, version="3.0", compiler=name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"version": "1.0"}, "FMI version = '1.0' is unknown; use 2.0 or 3.0"),
        ({"version": "3.0", "step": 0.0}, "step = 0.0 s; give a number above zero"),
        ({"version": "3.0", "step": float("nan")}, "step = nan s"),
    ],
)
def test_wrong_options(laws, options, message) -> None:
    law, parameters, texts = laws["fixed"]
    with pytest.raises(InputError, match=message):
        fmu(program(law, parameters, number(64)), texts, **options)
