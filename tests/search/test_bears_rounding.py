"""Laws that code cannot run are not taken, and the search goes on for one that it can."""

import pytest

from polefence import Design, Disk, InputError, NotProvedError, Structure, optimise, place
from polefence.certify.given import worst_case
from polefence.cli import optimise as command
from polefence.examples import spec_text
from polefence.export import FixedCode, FloatCode, Sampling, export_c99
from polefence.export.held import ranges_within
from polefence.plant.spec import loads
from polefence.region.regions import HalfPlane
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.rms import Rms
from support.commands import ran, refused
from support.fixed_points import MORE, RANGES, law_design

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


# --- in fixed point ------------------------------------------------------------------------------

CAR = {
    "suspension deflection": 0.15,
    "tyre deflection": 0.15,
    "sprung-mass velocity": 5.0,
    "unsprung-mass velocity": 5.0,
}


def test_a_law_found_for_sixteen_bits_is_exported_in_them():
    refusing, code = FixedCode(16, CAR), FixedCode(32, CAR)
    done = optimised(code)
    assert code.guarantee(done.design).proved
    assert export_c99(done.design, fixed=32, ranges=CAR).proved
    assert refusing.guarantee(done.design).proved == _exports(done.design, 16, CAR)


def _exports(design, bits, ranges, **options):
    try:
        return export_c99(design, fixed=bits, ranges=ranges, **options).proved
    except (InputError, NotProvedError):
        return False


@pytest.mark.parametrize("kind", ["one gain", "square", "scheduled", "own state", "pid"])
@pytest.mark.parametrize("bits", [16, 32])
def test_what_is_borne_is_exported_at_any_sample_time(kind, bits):
    design, ranges = law_design(kind), MORE.get(kind, RANGES)
    code = FixedCode(bits, ranges)
    proved = code(design)
    assert code.refused == (not proved)
    if kind not in MORE:
        assert proved == _exports(design, bits, ranges)
        return
    assert proved
    for time in (0.0031, 0.01):
        assert _exports(design, bits, ranges, sampling=Sampling(time, delay=0))


def test_sixteen_bits_are_refused_where_a_tight_region_needs_more():
    design = law_design("one gain")
    edge = Design(worst_case(design.plant, design.law, "half_plane").certificate)
    codes = FixedCode(16, RANGES), FixedCode(32, RANGES)
    assert [code(edge) for code in codes] == [False, True]
    assert [code.refused for code in codes] == [1, 0]


def test_ranges_follow_from_limits_and_those_that_are_given_come_first():
    limits = (
        Rms("a", density=1.0, at_most=0.5),
        InitialPeak("a", at_most=2.0, points=[[1.0]]),
        Rms("b", density=1.0, at_most=3.0),
        Rms("c", density=1.0),
    )
    assert ranges_within(limits) == {"a": 2.0, "b": 18.0}
    code = FixedCode(16, {"b": 1.0}, limits)
    assert code.ranges == {"a": 2.0, "b": 1.0}
    code.require(["a", "measured a", "b"])
    with pytest.raises(InputError, match=r"needs the range of c: .* --range 'c = 0.1', or a limit"):
        code.require(["a", "c"])
    with pytest.raises(InputError, match="use 16 or 32"):
        FixedCode(8)


def test_the_command_takes_ranges_of_what_is_measured(capsys, tmp_path):
    spec = tmp_path / "plant.toml"
    spec.write_text(spec_text("semi-active"))
    words = "optimise", spec, "--minimise", "rms of sprung-mass acceleration", "--schedule", "none"
    said = refused(capsys, *words, "--fixed", "32")
    assert "--fixed 32 needs the range of suspension deflection, tyre deflection" in said
    both = [x for name, v in CAR.items() for x in ("--range", f"{name} = {v}")]
    assert "give --fixed too" in refused(capsys, *words, *both)
    assert "nothing" in refused(capsys, *words, "--fixed", "32", *both, "--range", "nothing = 1")
    assert "not allowed with" in refused(capsys, *words, "--fixed", "16", "--float", "32", *both)
    said = ran(capsys, *words, "--fixed", "32", *both)
    assert "with the gain as fixed32 code computes it the region is proved too" in said
