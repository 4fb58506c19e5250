"""The package as it is built: with the kernel where there is a compiler, and without."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import polefence
from support.paths import ROOT


def test_the_engine_is_said():
    compiled = polefence.engine().startswith("compiled (")
    assert compiled or polefence.engine() == "numpy"
    # where the kernel is to be tested it must be there
    assert compiled or "POLEFENCE_TEST_COMPILED" not in os.environ


def wheel(tmp_path, **environment):
    """Build a wheel in a copy of the sources; return the names of its files."""
    source = tmp_path / "source"
    ignored = shutil.ignore_patterns("__pycache__", "*.so")
    shutil.copytree(ROOT / "src", source / "src", ignore=ignored)
    for name in ("pyproject.toml", "CMakeLists.txt", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    words = ["wheel", "--quiet", "--no-build-isolation", "--no-deps", "--wheel-dir", tmp_path]
    subprocess.run(
        [sys.executable, "-m", "pip", *words, source],
        check=True,
        env=os.environ
        | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
        | environment,
    )
    (path,) = tmp_path.glob("*.whl")
    return path, zipfile.ZipFile(path).namelist()


@pytest.mark.parametrize(
    "environment", [{"CXX": "/no/such/compiler"}, {"POLEFENCE_PURE": "1"}], ids=["none", "unwanted"]
)
def test_without_a_compiler_the_package_is_pure_python(tmp_path, environment):
    path, names = wheel(tmp_path, **environment)
    assert "polefence/lmi/solve/interior_point.py" in names
    assert not any("_kernel" in name for name in names)
    assert "polefence/__init__.pyi" in names  # the list of public names
    assert path.name.startswith(f"polefence-{polefence.__version__}-")
    site = tmp_path / "site"
    zipfile.ZipFile(path).extractall(site)
    program = (
        "import sys; sys.meta_path = [f for f in sys.meta_path if 'editable' not in repr(f)]\n"
        f"sys.path.insert(0, {str(site)!r})\n"
        "import polefence as pf; print(pf.engine())\n"
        "plant = pf.UncertainPlant.from_vertices([[[-1]], [[3]]], [[[1]], [[1]]])\n"
        "print(pf.tightest(plant, -5, 'quadratic').region.radius)"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    engine, radius = run.stdout.split()
    assert engine == "numpy"
    assert abs(float(radius) - 2) < 1e-5


# Compiles nothing of the kernel and of nanobind, which takes the most of its time: whether they
# compile is seen where the package under test is built.
QUICK = """#!/bin/sh
for word; do
    shift
    case "$word" in
        */nanobind/src/*.cpp | */src/kernel/*.cpp) set -- "$@" -x c++ /dev/null ;;
        *) set -- "$@" "$word" ;;
    esac
done
exec c++ "$@" -O0
"""


@pytest.mark.skipif(polefence.engine() == "numpy", reason="there is no compiler here")
def test_with_a_compiler_the_wheel_holds_the_kernel(tmp_path):
    compiler = tmp_path / "quick-c++"
    compiler.write_text(QUICK)
    compiler.chmod(0o755)
    _, names = wheel(tmp_path, CXX=str(compiler))
    assert sum("_kernel" in name for name in names) == 1
