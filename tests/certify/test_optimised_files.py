"""What `optimise` proved is what its file says, whatever was asked of the search."""

import pytest

from polefence import UncertainPlant
from polefence.certify.bounds import bounds_file
from polefence.certify.design import check
from polefence.cli.main import main
from polefence.lmi.conditions.methods import Scheduled
from polefence.plant.spec import load
from polefence.region.regions import HalfPlane, Sector
from polefence.requirements.rms import Rms
from polefence.search.optimise import optimise
from support.files import bounds_in

SPEC = """
name = "stage of two parameters"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["shock [m/s2]"]
[parameter.m]
range = [1, 2]
through = "1/m"
[parameter.k]
range = [1, 3]
[matrices]
A = [[0, 1], ["-k/m", "-0.2/m"]]
B = [[0], ["1/m"]]
E = [[0], [1]]
"""


@pytest.fixture(scope="module")
def plant(tmp_path_factory) -> UncertainPlant:
    path = tmp_path_factory.mktemp("spec") / "stage.toml"
    path.write_text(SPEC)
    return load(path)


@pytest.mark.parametrize("region", [HalfPlane(0), HalfPlane(0.3) & Sector(0.3)], ids=str)
@pytest.mark.parametrize("elevation", [0, 1])
@pytest.mark.parametrize("on", ["simplex", "box"])
def test_the_file_claims_what_was_proved(plant, tmp_path, on, elevation, region):
    """Number for number: the law, where alpha lives, and every bound with its evidence."""
    asked = Rms("x", density=2.0), [Rms("force", at_most=2.0, density=2.0)]
    found = optimise(plant, *asked, region, Scheduled(1, elevation, on))
    proved = [bound.claim for bound in found.bounds]
    read = bounds_in(bounds_file(found.design.certificate, proved).dumps())
    assert read == proved
    assert {claim.subject.on for claim in read} == {found.design.certificate.claim().on}
    assert check(found.save(tmp_path)).proved
    assert main(["check", str(tmp_path)]) == 0
