"""Plants that many tests share."""

import gc
import importlib.util
import os
import signal
import sys

import numpy as np
import pytest
from hypothesis import settings

if "POLEFENCE_TEST_KERNEL" in os.environ:  # a kernel built otherwise, with sanitizers say
    _spec = importlib.util.spec_from_file_location(
        "polefence._kernel", os.environ["POLEFENCE_TEST_KERNEL"]
    )
    sys.modules[_spec.name] = importlib.util.module_from_spec(_spec)
    _spec.loader.exec_module(sys.modules[_spec.name])

from polefence import Design, Disk, Scheduled, UncertainPlant, place, tightest
from polefence.examples import family
from support.every_file import write_every_file
from support.hasty import hasty
from support.lmi_alone import lmi_alone
from support.slow import SLOW

for _own in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS"):  # of a make that runs the tests, not of theirs
    os.environ.pop(_own, None)

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as of tests in a shell's background
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Beside all modules of tests a search for cycles takes long: 8 % of the time with Python's own
# thresholds, 3 % with these and without what is there before the first test.
gc.set_threshold(10_000, 20, 20)

# Machines that test are shared: time says nothing there. The same examples in every run.
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests of slow files, and begin with them: no worker is left alone with one."""
    here = config.rootpath / "tests"
    rank = {here / name: number for number, name in enumerate(SLOW)}
    for item in items:
        if item.path in rank:
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: rank.get(item.path, len(rank)))
    gc.freeze()


@pytest.fixture(autouse=True)
def ctrl_c_as_before():
    """After a command that Ctrl-C ended its process would ignore the next one."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def as_printed() -> UncertainPlant:
    return family("quarter-car-as-printed")


@pytest.fixture(scope="session")
def physical() -> UncertainPlant:
    return family("quarter-car-physical")


def random_plant(seed: int, n: int, m: int, N: int, spread: float = 0.2) -> UncertainPlant:
    """Vertices scattered around a random controllable pair; some are unstable."""
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    As = [A + spread * random.normal(size=(n, n)) for _ in range(N)]
    Bs = [B + spread * random.normal(size=(n, m)) for _ in range(N)]
    return UncertainPlant.from_vertices(As, Bs, name=f"random {seed}")


@pytest.fixture(scope="session")
def make_random():
    return random_plant


@pytest.fixture(scope="session")
def placed(as_printed) -> Design:
    """The paper's design: disk (-40, 31), scheduled, printed vertices."""
    return place(as_printed, Disk(-40, 31), "scheduled")


@pytest.fixture(scope="session")
def small_designs() -> dict[str, Design]:
    """One proved design of each kind for two-state plants with two inputs and three vertices."""
    plant = random_plant(5, 2, 2, 3, 0.1)
    return {
        "quadratic": tightest(plant, -3, "quadratic"),
        "slack": tightest(plant, -3, "slack"),
        "scheduled": tightest(plant, -3, "scheduled"),
        "right-hand sides": tightest(plant, -3, Scheduled(right_hand_sides=True)),
    }


@pytest.fixture(name="lmi_alone")
def methods_without_tuned_laws():
    with lmi_alone():
        yield


@pytest.fixture(name="hasty")
def searches_that_end_early():
    with hasty():
        yield


@pytest.fixture(scope="session")
def every_file(tmp_path_factory):
    """A folder with one file of every kind that the commands write, each proved; not to change."""
    made = tmp_path_factory.mktemp("every_file")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        with lmi_alone():
            write_every_file(made)
    return made
