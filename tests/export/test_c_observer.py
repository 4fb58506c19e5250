"""The observer's C: against numpy, in the loop with the law's C, and whatever it is given."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment
from shapes_of_laws import FUZZ, SANITIZED, STRICT, need, run

from polefence import (
    Disk,
    HalfPlane,
    InputError,
    Parameter,
    Scheduled,
    Sector,
    UncertainPlant,
    load,
    observe,
    place,
)
from polefence.export.c99 import Texts, sources
from polefence.export.number import number
from polefence.export.observer import (
    check_sample_time,
    judge_sampled_loop,
    longest_sample_time,
    observer_sources,
    observer_step,
    sampled_output_loop,
)
from polefence.export.program import program
from polefence.law import FixedGain
from polefence.observer import Observer
from polefence.suspension.quarter_car import family

SERVO = Path(__file__).parents[2] / "docs" / "examples" / "servo.toml"
SENSORS = ("suspension deflection", "sprung-mass velocity", "integral of suspension deflection")
CALLS = 3000
NO_MEASUREMENT, NO_INPUT, RESTARTED = 4, 8, 16


@cache
def car() -> UncertainPlant:
    return family("quarter-car-physical")


@cache
def accelerometer(sample_time=None) -> UncertainPlant:
    """A mass on a spring of uncertain stiffness; what is measured depends on the stiffness."""
    step = 1 if sample_time is None else float(sample_time)
    A = [[0, 1], ["-k", "-k/5"]]
    if sample_time is not None:
        A = [[1, step], [f"-{step}*k", f"1-{step}*k/5"]]
    return UncertainPlant.from_expressions(
        [Parameter("k", 1, 4)],
        A=A,
        B=[[0], [step]],
        states=("x [m]", "v [m/s]"),
        sample_time=sample_time,
    )


@cache
def single() -> UncertainPlant:
    """A plant without uncertainty."""
    return UncertainPlant.from_vertices([[[0, 1], [-3, -1]]], [[[0, 1], [2, 0]]])


def of_car(method, disk=Disk(-80, 30)):
    return lambda: observe(car(), SENSORS, disk, method)


def of_rate(method, sample_time=None):
    def made() -> Observer:
        plant = accelerometer(sample_time)
        Cs = [[v.exact_A[1]] for v in plant.vertices]
        region = Disk(0, "0.9") if sample_time else HalfPlane(1) & Sector(0.3)
        return observe(plant, Cs, region, method)

    return made


@dataclass(frozen=True)
class Case:
    label: str
    make: Callable[[], Observer]
    sample_time: float | None
    bits: int = 64
    by_alpha: bool = False

    @cache  # noqa: B019  (the cases live as long as the tests)
    def observer(self) -> Observer:
        return self.make()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return () if self.by_alpha else self.observer().plant.parameters

    @property
    def texts(self) -> Texts:
        n, m = self.observer().plant.shape
        return Texts("law", self.label, (), tuple(f"x{i}" for i in range(n)), ("u",) * m)

    def write(self, folder: Path) -> Path:
        """Write the observer beside some law of the plant, and the bounds that it is to clamp to."""
        folder.mkdir(parents=True, exist_ok=True)
        form, plant = number(self.bits), self.observer().plant
        law = program(FixedGain(np.ones(plant.shape[::-1])), (), form)
        files = sources(law, self.texts) | observer_sources(
            self.observer(), form, self.texts, self.parameters, self.sample_time
        )
        ends = [(form.outward(p.low, False), form.outward(p.high, True)) for p in self.parameters]
        for key, k in (("LOW", 0), ("HIGH", 1)):
            values = ", ".join(form.text(each[k]) for each in ends)
            files["bounds.h"] = files.get("bounds.h", "") + f"#define {key} {{ {values} }}\n"
        for name, text in files.items():
            (folder / name).write_text(text)
        return folder


CASES = [
    Case("car, scheduled", of_car("scheduled"), 2e-3),
    Case("car, scheduled, single", of_car("scheduled"), 2e-3, 32),
    Case("car, scheduled, single, alpha", of_car("scheduled"), 9.9e-3, 32, True),
    Case("car, one gain, single", of_car("quadratic", Disk(-80, 60)), 1e-3, 32),
    Case("car, degree 2 on the box", of_car(Scheduled(2, 1, "box")), 5e-4),
    Case("servo", lambda: observe(load(SERVO), ["motor angle"], Disk(-20, 14)), 0.02, 32),
    Case("C of alpha, degree 2, given alpha", of_rate(Scheduled(2, 1)), 0.05, 64, True),
    Case("one vertex, two inputs", lambda: observe(single(), [[1, 0]], Disk(-5, 3)), 0.01),
    Case("discrete time", of_rate("scheduled", "0.1"), None),
    Case("discrete time, one gain, single", of_rate("quadratic", "0.1"), None, 32),
]
BY_LABEL = {case.label: case for case in CASES}
labels = pytest.mark.parametrize("label", BY_LABEL)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """For each case its folder, and what gcc said of the library and of the fuzz driver."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("observers")
    folders = [case.write(root / re.sub(r"\W+", "-", case.label)) for case in CASES]

    def build(folder: Path):
        include, code = f"-I{folder}", folder / "law_observer.c"
        library = ("-shared", "-fPIC", "-o", folder / "observer.so")
        strict = run(gcc, *STRICT, "-fanalyzer", include, code, FUZZ / "observer_many.c", *library)
        driver = ("-o", folder / "fuzz", "-lm")
        sanitized = run(gcc, *SANITIZED, include, code, FUZZ / "observer_fuzz.c", *driver)
        return folder, strict, sanitized

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(BY_LABEL, pool.map(build, folders), strict=True))


@labels
def test_compiles_without_a_warning_and_passes_the_analyser(built, label):
    folder, strict, _ = built[label]
    assert (strict.returncode, strict.stderr) == (0, "")
    for name in ("law_observer.c", "law_observer.h"):
        text = (folder / name).read_text()
        assert "Undefined" not in text
        assert max(map(len, text.splitlines())) <= 110


@labels
def test_answers_as_documented_whatever_is_given(built, label):
    folder, _, sanitized = built[label]
    assert sanitized.returncode == 0, sanitized.stderr
    ran = run(folder / "fuzz", 1, 20000)
    assert ran.returncode == 0, ran.stdout + ran.stderr


FAULTS = {
    "half a measurement": ("measured ? sum : 0.0F", "(y[j] != 0.0F) ? sum : 0.0F"),
    "NaN in u goes on": ("copy[i] = finite ? values[i] : 0.0F", "copy[i] = values[i]"),
    "a restart unsaid": ("flags |= LAW_OBSERVER_RESTARTED;", ""),
    "no u unsaid": ("flags |= LAW_OBSERVER_NO_INPUT;", ""),
    "no y unsaid": ("flags |= LAW_OBSERVER_NO_MEASUREMENT;", ""),
    "reads beyond y": ("take(y, MEASURED, seen)", "take(y, MEASURED + 1U, seen)"),
    "reads beyond x": ("at->c[j][i] * x[i]", "at->c[j][i] * x[i + j + 2U]"),
    "a row too many": (
        "i < (STATES + MEASURED); i++) {\n            l",
        "i <= (STATES + MEASURED); i++) {\n            l",
    ),
}


@pytest.fixture(scope="session")
def faulty(tmp_path_factory):
    """For each fault what the fuzz run said of it."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("faults")
    case = BY_LABEL["car, scheduled, single"]
    folders = {fault: case.write(root / str(k)) for k, fault in enumerate(FAULTS)}

    def tried(fault: str) -> int:
        folder, (old, new) = folders[fault], FAULTS[fault]
        text = (folder / "law_observer.c").read_text()
        if text.count(old) != 1:
            return -1
        (folder / "law_observer.c").write_text(text.replace(old, new))
        code = folder / "law_observer.c"
        driver = (FUZZ / "observer_fuzz.c", "-o", folder / "fuzz", "-lm")
        made = run(gcc, *SANITIZED, f"-I{folder}", code, *driver)
        return run(folder / "fuzz", 1, 5000).returncode if made.returncode == 0 else -2

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(FAULTS, pool.map(tried, FAULTS), strict=True))


@pytest.mark.parametrize("fault", FAULTS)
def test_the_fuzz_run_finds_a_fault(faulty, fault):
    assert faulty[fault] == 1
