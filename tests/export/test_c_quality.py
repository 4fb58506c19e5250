"""The generated C: no warning, no finding that the docs do not list, the documented answers."""

import ctypes
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polefence.base.errors import InputError
from polefence.export.sources import sources
from support.memories import exported
from support.needed import need
from support.paths import DOCS
from support.shapes_of_laws import (
    BETA,
    BY_LABEL,
    FUZZ,
    LEFT,
    M1,
    SANITIZED,
    SHAPES,
    STRICT,
    Shape,
    run,
    weights,
)

PAGE = DOCS / "export-misra.md"
CHECKED = ("fixed, two inputs with limits, double", "two parameters, limits")
CHECKED += ("degree 2 on the box, alpha, double", "polynomial of signals, limits")
CALLS = 4000
labels = pytest.mark.parametrize("label", BY_LABEL)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """For each shape its folder, and what gcc said of the library and of the fuzz driver."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("shapes")

    def build(shape: Shape):
        folder = shape.write(root / re.sub(r"\W+", "-", shape.label))
        include, law = f"-I{folder}", folder / "law.c"
        library = ("-shared", "-fPIC", "-o", folder / "law.so")
        strict = run(gcc, *STRICT, "-fanalyzer", include, law, FUZZ / "many.c", *library)
        driver = ("-o", folder / "fuzz", "-lm")
        sanitized = run(gcc, *SANITIZED, include, law, FUZZ / "fuzz.c", *driver)
        return folder, strict, sanitized

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(BY_LABEL, pool.map(build, SHAPES), strict=True))


@labels
def test_compiles_without_a_warning_and_passes_the_analyser(built, label):
    _, strict, _ = built[label]
    assert strict.returncode == 0, strict.stderr
    assert strict.stderr == ""


@labels
def test_answers_as_documented_whatever_is_given(built, label):
    folder, _, sanitized = built[label]
    assert sanitized.returncode == 0, sanitized.stderr
    ran = run(folder / "fuzz", 1, 20000)
    assert ran.returncode == 0, ran.stdout + ran.stderr


LIMITED, LAST = "two parameters, limits", "one parameter, one state"
ALPHA = "alpha of three"
FAULTS = {
    "a bound without its flag": (
        LIMITED,
        "result = low;\n        *flags |= LAW_CLAMPED;",
        "result = low;",
    ),
    "NaN without its flag": (LIMITED, "*flags |= LAW_NOT_A_NUMBER;", ""),
    "NaN at low": (LIMITED, "0.5F * (low + high)", "low"),
    "limit without its flag": (
        LIMITED,
        "result = limit;\n        *flags |= LAW_LIMITED;",
        "result = limit;",
    ),
    "only the upper limit": (LIMITED, "result = -limit;", ""),
    "limits a little too large": (LIMITED, "{ 2.0F, ", "{ 2.00000024F, "),
    "no control, but u": (LIMITED, "u[i] = 0.0F;", "u[i] = LIMIT[i];"),
    "no control unsaid": (LIMITED, "flags |= LAW_NO_CONTROL;", ""),
    "infinity is finite": (LAST, "(value <= FLT_MAX)", "(value <= 2.0F * FLT_MAX)"),
    "weights not cut": (ALPHA, "weight = 0.0F;", ""),
    "weights of no sum": (ALPHA, "(total >= 1e-30F) && ", ""),
    "cut in silence": (ALPHA, "flags = LAW_CLAMPED;\n            }", "}"),
    "a row too many": (LIMITED, "i <= STATES; i++", "i <= STATES + 1U; i++"),
    "reads beyond x": (LIMITED, "y += T[entry] * x[j];", "y += T[entry] * x[j + i];"),
    "divides by zero": (LIMITED, "1.0F / rows[j][j]", "1.0F / (rows[j][j] - rows[j][j])"),
}


@pytest.fixture(scope="session")
def faulty(tmp_path_factory):
    """How the fuzz run of a law with each fault ends; None if it does not compile."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("faults")

    def ended(fault: str) -> int | None:
        label, old, new = FAULTS[fault]
        folder = BY_LABEL[label].write(root / re.sub(r"\W+", "-", fault))
        text = (folder / "law.c").read_text()
        assert text.count(old) == 1
        (folder / "law.c").write_text(text.replace(old, new))
        driver = ("-o", folder / "fuzz", "-lm")
        made = run(gcc, *SANITIZED, f"-I{folder}", folder / "law.c", FUZZ / "fuzz.c", *driver)
        return None if made.returncode else run(folder / "fuzz", 1, 20000).returncode

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(FAULTS, pool.map(ended, FAULTS), strict=True))


@pytest.mark.parametrize("fault", FAULTS)
def test_the_fuzz_run_finds_a_fault(faulty, fault):
    assert faulty[fault] == 1


def test_the_weights_here_are_those_of_the_law():
    law = BY_LABEL["three parameters"].law
    alpha = weights(np.array([[300.0, 2.5, -1.1]]), (M1, BETA, LEFT))
    exact = law.gain_at(m1=300.0, beta=2.5, left=-1.1)
    assert np.allclose(law.gain(alpha)[0], exact, rtol=1e-12, atol=0)


def called(folder: Path, shape: Shape, given: np.ndarray, x: np.ndarray):
    real = np.float32 if shape.bits == 32 else np.float64
    given, x = np.ascontiguousarray(given, real), np.ascontiguousarray(x, real)
    u, flags = np.full((len(x), shape.m), np.nan, real), np.zeros(len(x), np.uint32)
    library = ctypes.CDLL(str(folder / "law.so"))
    arrays = (a.ctypes.data_as(ctypes.c_void_p) for a in (given, x, u, flags))
    library.many(ctypes.c_uint32(len(x)), *arrays)
    return given.astype(float), x.astype(float), u.astype(float), flags


def drawn(shape: Shape, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters or weights, and states, within what the law is for."""
    random = np.random.default_rng(3)
    x = random.normal(size=(count, shape.n)) * shape.units
    if not shape.parameters:
        return random.dirichlet(np.ones(int(np.prod(shape.sizes or (1,)))), count), x
    ends = np.array([[float(p.low), float(p.high)] for p in shape.parameters]).T
    inside = 1e-5 * np.array([[1], [-1]])  # also when rounded to float32
    return random.uniform(*(ends + inside), (count, len(shape.parameters))), x


@labels
def test_computes_what_the_law_does(built, label):
    folder, strict, _ = built[label]
    assert strict.returncode == 0
    shape = BY_LABEL[label]
    given, x, u, flags = called(folder, shape, *drawn(shape, CALLS))
    alpha = weights(given, shape.parameters) if shape.parameters else given
    K = shape.law.gain(alpha, clamp=True)
    wanted = np.einsum("kmn,kn->km", K, x)
    bound = np.einsum("kmn,kn->km", np.abs(K), np.abs(x)) * (1e-5 if shape.bits == 32 else 1e-12)
    if shape.limits:
        over = np.abs(wanted) - shape.limits
        limited, sure = np.any(over > 0, axis=1), np.all(np.abs(over) > bound, axis=1)
        assert 0.1 * CALLS < limited.sum() < 0.9 * CALLS
        assert np.all(~sure | (flags == np.where(limited, 8, 0)))
        wanted = np.clip(wanted, -np.array(shape.limits), shape.limits)
    else:
        assert np.all(flags == 0)
    assert np.all(np.abs(u - wanted) <= bound)


def test_a_header_of_cpp(tmp_path):
    gcc, gpp = need("gcc"), need("g++")
    folder = BY_LABEL["two parameters"].write(tmp_path)
    (folder / "main.cpp").write_text(
        '#include "law.h"\n#include "law.h"\n'
        "int main() {\n"
        "    const law_real p[LAW_PARAMETERS] = {300.0F, 0.0F}, x[LAW_STATES] = {};\n"
        "    law_real u[LAW_INPUTS];\n"
        "    return static_cast<int>(law_update(p, x, u) - LAW_OK);\n"
        "}\n"
    )
    law = run(gcc, "-std=c99", "-c", folder / "law.c", "-o", folder / "law.o")
    warnings = ("-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
    made = run(gpp, *warnings, folder / "main.cpp", folder / "law.o", "-o", folder / "main")
    assert (law.returncode, made.returncode) == (0, 0), law.stderr + made.stderr
    assert run(folder / "main").returncode == 0


@pytest.mark.parametrize("option", ["-ffast-math", "-ffinite-math-only", "-Ofast"])
def test_options_that_break_the_law_are_refused(tmp_path, option):
    folder = BY_LABEL["fixed, one input"].write(tmp_path)
    made = run(need("gcc"), "-std=c99", "-O2", option, "-fsyntax-only", folder / "law.c")
    assert made.returncode != 0
    assert "#error" in made.stderr


def findings(folder: Path) -> set[str]:
    """What cppcheck says of the laws in a folder, as one program, by its identifiers."""
    options = ("-q", "--std=c99", "--enable=all", "--addon=misra", "--template={id}")
    # its library knows the standard headers
    hidden = "--suppress=missingIncludeSystem"
    ran = run(need("cppcheck"), *options, hidden, *sorted(folder.glob("*.c")))
    assert (ran.returncode, ran.stdout) == (0, "")
    assert all(re.fullmatch(r"[\w.-]+", word) for word in ran.stderr.split()), ran.stderr
    return set(ran.stderr.split())


def listed() -> set[str]:
    """The identifiers of the findings that the docs justify."""
    table = PAGE.read_text().split("## Fixed")[0]
    return set(re.findall(r"^\| `([\w.-]+)` \|", table, flags=re.M))


@pytest.fixture(scope="session")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cppcheck")
    for k, label in enumerate(CHECKED):
        shape = BY_LABEL[label]
        texts = replace(shape.texts, name=f"law{k}", sample_time=0.001, delay=1)
        for name, text in sources(shape.program, texts).items():
            (folder / name).write_text(text)
    for name in ("law.c", "law.h"):  # one that keeps states
        (folder / name).write_bytes(exported("affine", 32).files[name])
    return findings(folder)


def test_findings_of_cppcheck_are_those_that_the_docs_list(found):
    assert found == listed()


def test_a_new_finding_would_be_seen(tmp_path):
    folder = BY_LABEL["fixed, one input"].write(tmp_path)
    text = (folder / "law.c").read_text().replace("bool finite = true;", "int finite = 1, spare;")
    (folder / "law.c").write_text(text)
    assert findings(folder) - listed() >= {"misra-c2012-12.3", "unusedVariable"}


def test_texts_that_are_not_the_programs_are_refused():
    shape = BY_LABEL["two parameters, limits"]
    for change, says in (
        ({"states": ("one",)}, "1 states and 2 inputs are named; the law has 5 and 2"),
        ({"limits": (1.0,)}, "1 limits are given; the law has 2 inputs"),
        ({"limits": (1.0, 0.0)}, "limit = 0.0 must be a number"),
        ({"limits": (1.0, float("nan"))}, "limit = nan must be a number"),
        ({"limits": (float("inf"), 1.0)}, "limit = inf must be a number"),
    ):
        with pytest.raises(InputError, match=re.escape(says)):
            sources(shape.program, replace(shape.texts, **change))
