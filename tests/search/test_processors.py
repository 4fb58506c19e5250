"""Work on small matrices uses one thread of each BLAS, also of one that it loads; none after it."""

import json
import os
import subprocess
import sys

import pytest

from polefence.base.processors import small_matrices

SCRIPT = """
import json
import numpy
from threadpoolctl import threadpool_info
from polefence.base.processors import small_matrices


def threads():
    every = [own for own in threadpool_info() if own["user_api"] == "blas"]
    return {own["filepath"]: own["num_threads"] for own in every}


before = threads()
with small_matrices():
    with small_matrices():
        import scipy.linalg
    inside = threads()
print(json.dumps([before, inside, threads()]))
"""


@pytest.mark.parametrize("given", [None, "2"])
def test_a_blas_that_is_loaded_meanwhile_has_one_thread_then_all(given):
    own = {k: v for k, v in os.environ.items() if k not in ("OPENBLAS_NUM_THREADS",)}
    own["OMP_NUM_THREADS"] = "2"
    own |= {"OPENBLAS_NUM_THREADS": given} if given else {}
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT], check=True, capture_output=True, text=True, env=own
    )
    before, inside, after = json.loads(run.stdout)
    assert set(before.values()) == {2}
    if len(inside) == len(before):
        pytest.skip("SciPy brings no BLAS of its own here")
    # what the environment says of a library that is loaded is the user's
    assert {inside[path] for path in before} == {1}
    assert {inside[path] for path in inside if path not in before} == {2 if given else 1}
    assert set(after.values()) == {2}


def test_the_environment_is_as_before():
    before = os.environ.get("OPENBLAS_NUM_THREADS")
    with small_matrices():
        assert os.environ["OPENBLAS_NUM_THREADS"] == (before or "1")
    assert os.environ.get("OPENBLAS_NUM_THREADS") == before
