"""Laws that code cannot run are not taken, and the search goes on for one that it can."""

import pytest

from polefence import Disk, NotProvedError, Structure, optimise, place
from polefence.cli import optimise as command
from polefence.examples import spec_text
from polefence.export import FloatCode
from polefence.plant.spec import loads
from polefence.region.regions import HalfPlane
from polefence.requirements.rms import Rms
from support.commands import ran, refused

ONE_GAIN = Structure(schedule=())


def optimised(bears):
    plant = loads(spec_text("semi-active"))
    asked = Rms("sprung-mass acceleration"), (), HalfPlane(1)
    return optimise(plant, *asked, structure=ONE_GAIN, bears=bears)


def test_a_tight_region_bears_float64_and_not_float32(physical):
    design = place(physical, Disk(-40, 29.08), "scheduled")
    codes = FloatCode(32), FloatCode(64)
    assert [code(design) for code in codes] == [False, True]
    assert [code.refused for code in codes] == [1, 0]


def test_a_law_that_is_taken_bears_it():
    code = FloatCode(32)
    done = optimised(code)
    assert code.guarantee(done.design).proved
    assert done.bounds[0].level == optimised(None).bounds[0].level


def test_one_farther_inside_takes_the_place_of_one_that_is_refused():
    seen = []

    def second(design):
        seen.append(max(pole.real for pole in design.poles([[1.0, 0.0]]).ravel()))
        return len(seen) > 1

    done = optimised(second)
    assert len(seen) > 1
    assert done.design.proved
    assert done.bounds[0].level >= optimised(None).bounds[0].level * (1 - 1e-6)


def test_none_is_returned_where_none_is_taken():
    with pytest.raises(NotProvedError):
        optimised(lambda design: False)


def test_the_command_says_so(capsys, tmp_path, monkeypatch):
    spec = tmp_path / "plant.toml"
    spec.write_text(spec_text("semi-active"))
    words = "optimise", spec, "--minimise", "rms of sprung-mass acceleration", "--schedule", "none"
    said = ran(capsys, *words, "--float", "32")
    assert "with the gain as float32 code computes it the region is proved too" in said

    class Never(FloatCode):
        def __call__(self, design):
            self.refused += 1
            return False

    monkeypatch.setattr(command, "FloatCode", Never)
    said = refused(capsys, *words, "--float", "32", status=1)
    assert "but that the poles stay in the region with the rounding of float32 code" in said
    assert "or take --float 64" in said
