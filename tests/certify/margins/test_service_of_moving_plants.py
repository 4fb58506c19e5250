"""Margins of plants whose parameters move: those of constant ones, of the plant as it is."""

import json
from dataclasses import replace

import numpy as np
import pytest

from polefence import Design, Parameter, UncertainPlant, place
from polefence.certify.design import check
from polefence.certify.margins import in_service
from polefence.cli.main import main
from polefence.region.regions import Disk, HalfPlane
from support.commands import ran

SPEC = """
states = ["x [m]", "v [m/s]"]
constants = {c = 1}
[parameter.m]
range = [2, 3]
through = "1/m"
[parameter.k]
range = [1, 2]
rate = "any"
[matrices]
A = [[0, 1], ["-k", "-c"]]
B = [[0], ["1/m"]]
"""


def spring(rate, step=None) -> UncertainPlant:
    parameters = [Parameter("m", 2, 3, "kg", "1/m"), Parameter("k", 1, 2, "N/m", rate=rate)]
    A, B = [["0", "1"], ["-k", "-1"]], [["0"], ["1/m"]]
    if step is not None:
        A, B = [["1", "0.1"], ["-0.1*k", "0.9"]], [["0"], ["0.1/m"]]
    return UncertainPlant.from_expressions(parameters, A, B, sample_time=step)


@pytest.mark.parametrize("rate", ["any", (-1, 1)])
@pytest.mark.parametrize(
    ("step", "region"), [(None, HalfPlane(0.2)), ("0.1", Disk(0, 0.97))], ids=["s", "z"]
)
@pytest.mark.parametrize("method", ["scheduled", "quadratic"])
def test_they_are_those_of_the_plant_at_rest(rate, step, region, method):
    """A gain's evidence depends on a parameter that moves at any rate, and may: it is at rest."""
    design = place(spring(rate, step), region, method=method)
    found = in_service(design)
    still = Design(replace(design.certificate, plant=spring(None, step)))
    assert [(own.name, own.value) for own in found] == [
        (own.name, own.value) for own in in_service(still)
    ]
    for margin in found:
        document = found.file(margin)
        document.require_checkable()  # which reads it back, too
        assert [own.rate for own in document.plant.ranges] == [None, design.plant.moving[0].rate]
        assert margin.claim.subject.ranges == document.plant.ranges
    gain = found["gain"]
    random = np.random.default_rng(3)
    alpha = [design.plant.alpha(m=m, k=k) for m, k in random.uniform((2, 1), (3, 2), (300, 2))]
    A, B = design.plant.at(np.array(alpha))
    off = gain.value * random.choice([-1.0, 1.0], (300, 1, 2)) * np.array(gain.claim.sizes, float)
    assert 0.1 < gain.value < (gain.upper or np.inf)
    assert region.contains(np.linalg.eigvals(A + B @ (design.law.gain(np.array(alpha)) + off)))


def test_another_region_is_proved_at_rest():
    """The proof made anew is none along motions, and does not say that it is one."""
    design = place(spring("any"), Disk(-3, 2.5), method="slack")
    gain = in_service(design, region=HalfPlane(0))["gain"]
    still = Design(replace(design.certificate, plant=spring(None)))
    assert gain.value == in_service(still, region=HalfPlane(0))["gain"].value > 0.5
    assert not gain.design.proved
    gain.file(design).require_checkable()


def test_the_command_writes_files_that_are_proved(tmp_path, capsys):
    spec, files = tmp_path / "plant.toml", tmp_path / "files"
    spec.write_text(SPEC)
    asked = ["--region", "half_plane(0.2)", "-o", str(tmp_path)]
    assert main(["design", str(spec), *asked]) == 0
    assert main(["service", str(tmp_path / "design.json"), "-o", str(files)]) == 0
    paths = sorted(files.iterdir())
    assert {path.stem for path in paths} >= {"estimate", "estimate-k", "estimate-m", "gain"}
    for path in paths:
        assert check(path).proved, path.name
        parameters = json.loads(path.read_text())["plant"]["parameters"]
        assert [own.get("rate") for own in parameters] == [None, "any"]
        said = ran(capsys, "check", path, "--spec", spec)
        assert "for constant parameters" in said or path.stem.startswith("rate")
