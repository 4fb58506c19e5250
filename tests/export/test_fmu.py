"""FMUs, run by fmpy: the same u as the law in Python, and what the standard asks of them."""

from __future__ import annotations

import ctypes
import io
import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
import zipfile
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polefence import Disk, FixedGain, place
from polefence.errors import InputError
from polefence.export import shared_library
from polefence.export.c99 import Texts
from polefence.export.fmi_variables import plain, split, unique
from polefence.export.fmu import fmu
from polefence.export.number import number
from polefence.export.program import program
from polefence.export.shared_library import platform
from polefence.response.discrete import held
from polefence.response.drive import drive
from polefence.response.driving.parts import Sampling

BOTH = pytest.mark.parametrize("version", ["2.0", "3.0"])
KINDS = ("parameters", "alpha", "fixed", "limited")
STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror"]
CAR = {"m1": 260.0, "beta": 4.0}
HOSTILE = ('<&"\'>]]>\n{{ x }} */ "', "Fläche 😀\x00\x1f\ud800", "", "9 a", "9 A", "a [m]", "a [kg]")


def absent(what: str) -> None:
    """Skip, or fail where the tests of targets are asked for."""
    message = f"{what} is not installed"
    if os.environ.get("POLEFENCE_TEST_TARGET") == "1":
        pytest.fail(message)
    pytest.skip(message)


@pytest.fixture(scope="module")
def compiler():
    return shutil.which("cc") or absent("a C compiler, cc,")


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
            content = fmu(
                program(law, parameters, number(bits)), texts, version=version, step=5e-4
            )
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
        return self.raw.doStep(
            currentCommunicationPoint=start, communicationStepSize=length
        )

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
def test_validation_can_fail(built, fmpy, version, tmp_path) -> None:
    from fmpy.validation import validate_fmu

    path = tmp_path / "broken.fmu"
    with zipfile.ZipFile(built("fixed", version)) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b'initial="calculated"', b"", 1))
            if name == "modelDescription.xml":
                text = old.read(name).decode().replace('name="x2"', 'name="x1"')
                new.writestr(name, text) if False else None
    assert validate_fmu(str(path)) is not None
