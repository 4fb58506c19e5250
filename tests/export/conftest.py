"""Compilers and the emulator: where they are absent tests skip, but in continuous integration."""

import pytest

from polefence import Disk, Scheduled, place
from support.cortex import HOST_TOOLS, export, missing_tools
from support.needed import require


@pytest.fixture(scope="session")
def host_compiler() -> None:
    require(missing_tools(HOST_TOOLS))


@pytest.fixture(scope="session")
def emulator() -> None:
    require(missing_tools())


@pytest.fixture(scope="session")
def car_designs(physical):
    return {
        "scheduled": place(physical, Disk(-40, 31), "scheduled"),
        "degree 2": place(physical, Disk(-40, 31), Scheduled(degree=2, on="box")),
        "fixed": place(physical, Disk(-40, 35), "quadratic"),
    }


@pytest.fixture(scope="session")
def exported(car_designs, tmp_path_factory):
    """Return folders of code, each made once."""
    made = {}

    def get(kind: str, bits: int, given: str = "parameters"):
        key = kind, bits, given
        if key not in made:
            made[key] = export(car_designs[kind], bits, tmp_path_factory.mktemp("law"), given)
        return made[key]

    return get
