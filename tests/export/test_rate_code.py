"""Code that keeps to a rate: what it moves in an update, its memory, tests and units."""

import ctypes
from functools import cache

import numpy as np
import pytest

from polefence import (
    Disk,
    FixedGain,
    PolynomialGain,
    Saturation,
    ScheduledGain,
    analyse,
    at_sample_time,
)
from polefence.base.errors import DesignFileError, InputError
from polefence.certify.bounds import best_bound
from polefence.export import check_guarantee, export_c99
from polefence.export.ends import proved_ends
from polefence.export.fmu import fmu
from polefence.export.vectors import HELD_BACK, LIMITED, Ends, special, vectors
from polefence.plant.delta import delta_form
from polefence.plant.larger import with_states
from support.cortex import run
from support.files import rewritten
from support.lag import lag
from support.shapes_of_laws import SANITIZED, STRICT

T, LIMIT, RATE, OWN = 0.02, 1.5, 12.0, -0.375
NO_CONTROL = 4


@cache
def design(kind):
    plant, box = at_sample_time(lag("x [m]", "u [N]"), T, 1), lag().parameters
    if kind == "own states":
        plant = with_states(plant, 1)
        law = PolynomialGain(((0, 0),), [[(-4.0, -0.1, -3.0), (1.0, 0.0, 0.0)]], (), box)
        law = law.with_anti_windup(np.array([[0.0, 0.0], [0.0, 0.0], [OWN, 0.0]]))
    else:
        K = [[-4.0, -0.1]]
        law = {
            "one gain": FixedGain(K),
            "polynomial": PolynomialGain(((0, 0), (1, 0)), [K, [[0.5, 0.0]]], (), box),
            "scheduled": ScheduledGain(np.stack([np.eye(2)] * 4), np.stack([K] * 4), box, 1, (4,)),
        }[kind]
    return analyse(plant, law, Disk(0, 1)).design


KINDS = ("one gain", "polynomial", "scheduled", "own states")


@cache
def exported(kind, bits=64, limits=LIMIT, rates=RATE):
    return export_c99(design(kind), bits, limits=limits or (), rates=rates, given=None)


class Code:
    """The compiled code of a law with a state of its own, given x and what was sent last."""

    def __init__(self, made, folder):
        made.save(folder)
        run("cc", "-std=c99", "-shared", "-fPIC", "-O1", "-o", "law.so", "law.c", cwd=folder)
        self.law = ctypes.CDLL(str(folder / "law.so"))
        self.memory, self.u = (ctypes.c_double * 2)(), (ctypes.c_double * 1)()
        self.law.law_reset(self.memory)

    def tick(self, *x):
        flags = self.law.law_update(self.memory, (ctypes.c_double * len(x))(*x), self.u)
        return flags, self.u[0]


def test_it_moves_as_the_equations_say_from_zero_on(host_compiler, tmp_path):
    code, z, last, seen = Code(exported("own states"), tmp_path), 0.0, 0.0, set()
    for k, x in enumerate(np.random.default_rng(2).uniform(-0.5, 0.5, 600)):
        x = 0.1 * x if k > 300 else x
        asked = -4 * x - 0.1 * last - 3 * z
        inside = min(max(asked, -LIMIT), LIMIT)
        u = min(max(inside, last - RATE * T), last + RATE * T)
        z += T * (x + OWN * (u - asked))
        flags, sent = code.tick(x, last)
        assert sent == pytest.approx(u, abs=1e-12)
        assert list(code.memory) == pytest.approx([z, u], abs=1e-12)
        assert flags == LIMITED * (abs(asked) > LIMIT) + HELD_BACK * (u != inside)
        assert k or sent == -RATE * T * np.sign(x)
        seen.add(flags)
        last = u
    assert seen == {0, HELD_BACK, LIMITED + HELD_BACK}


def test_it_takes_over_from_what_acts(host_compiler, tmp_path):
    code, acts = Code(exported("own states"), tmp_path), 1.1
    x = (ctypes.c_double * 2)(0.3, acts)
    assert code.law.law_start(code.memory, x, (ctypes.c_double * 1)(acts)) == 0
    assert code.memory[1] == acts
    assert code.tick(0.3, acts) == (0, pytest.approx(acts))
    assert code.tick(-9.0, acts) == (LIMITED + HELD_BACK, pytest.approx(acts + RATE * T))


def test_what_is_no_number_takes_it_to_zero_no_faster(host_compiler, tmp_path):
    code = Code(exported("own states"), tmp_path)
    sent = [code.tick(-0.5, 0.0)[1] for _ in range(4)]
    assert sent == pytest.approx([RATE * T * (k + 1) for k in range(4)])
    flags, u = code.tick(np.nan, 0.0)
    assert flags == NO_CONTROL + HELD_BACK
    assert u == pytest.approx(3 * RATE * T)
    assert [code.tick(np.nan, 0.0)[1] for _ in range(5)][-1] == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bits", [32, 64])
def test_its_own_test_covers_what_is_held_back(host_compiler, tmp_path, kind, bits):
    made = exported(kind, bits, LIMIT if kind == "own states" else None)
    assert made.proved
    made.save(tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror", cwd=tmp_path).splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2
    ends = Ends(made.texts.limits, made.texts.steps)
    for table in (vectors, special):
        flags = table(made.program, made.design.law, ends).flags
        assert 0 < np.count_nonzero(flags & HELD_BACK) < len(flags)
    assert check_guarantee(tmp_path).proved
    for flags in ([*STRICT, "-fanalyzer"], SANITIZED):
        run("gcc", *flags, "law.c", "law_test.c", "-o", "test", cwd=tmp_path)
        run("./test", cwd=tmp_path)
    # a step that is a little longer fails, and a memory that is not what was sent
    text = made.files["law.c"].decode()
    number = text.split("STEP[INPUTS] = { ")[1].split(" }")[0]
    for now, other in ((number, f"(1.001 * {number})"), ("memory->u[i] = u[i]", "u[i] = u[i]")):
        (tmp_path / "law.c").write_text(text.replace(now, other))
        run("gcc", "law.c", "law_test.c", "-o", "test", cwd=tmp_path)
        with pytest.raises(Exception, match="FAILED"):
            run("./test", cwd=tmp_path)


def test_the_folder_is_checked_and_says_so(tmp_path):
    made = exported("one gain", 64, None)
    made.save(tmp_path)
    header = made.files["law.h"].decode()
    assert "by at most 12 a second, 0.24 an update" in header
    assert "each input moves by no more than its rate limit" in " ".join(header.split()).replace(
        " * ", " "
    )
    assert check_guarantee(tmp_path).proved
    for rates, says in (([13.0], "law.h is not what"), ([-1], "positive"), ("x", "lists")):
        with rewritten(tmp_path / "guarantee.json") as table:
            table["export"]["text"]["rates"] = rates
        if says.startswith("law"):
            assert says in check_guarantee(tmp_path).reason.replace("law.c", "law.h")
        else:
            with pytest.raises(DesignFileError, match=says):
                check_guarantee(tmp_path)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rates": (1.0, 2.0)}, "rates: 2 numbers for 1 inputs"),
        ({"rates": -1.0}, "rates: -1.0 must be a number from 1e-30 to 1e30, in the input's unit/s"),
        ({"rates": 1.0, "fixed": 32}, "fixed-point code keeps to none"),
    ],
)
def test_rates_that_are_none(options, says):
    with pytest.raises(InputError, match=says):
        export_c99(design("one gain"), **options)


def test_a_law_in_continuous_time_needs_a_sample_time():
    found = analyse(lag(), FixedGain([[-4.0]]), Disk(-10, 9.9)).design
    with pytest.raises(InputError, match="give --sample-time too"):
        export_c99(found, rates=1.0)


def test_what_is_proved_is_what_its_code_keeps():
    made = design("one gain")
    plant, start = delta_form(made.plant), [(0.1, 0.0)]
    both = Saturation(["u", "rate of u"], points=start, limits=(2.0, 30.0))
    alone = Saturation("rate of u", points=start)
    claims = [best_bound(plant, made.law, asked).claim for asked in (both, alone)]
    share, rate = (float(claim.level) for claim in claims)
    ends = proved_ends(made, claims)
    assert ends.limits == pytest.approx((2.0 * share,))
    assert ends.rates == pytest.approx((max(30.0 * share, rate),))
    assert proved_ends(made, []).rates == ()


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_its_unit_moves_no_faster(host_compiler, tmp_path, version):
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    made, path = exported("own states"), tmp_path / "law.fmu"
    path.write_bytes(fmu(made.program, made.texts, version=version))
    assert validate_fmu(str(path)) == []
    about = fmpy.read_model_description(str(path))
    names = [v.name for v in about.modelVariables if v.causality == "input"]
    found = fmpy.simulate_fmu(
        str(path), start_values={names[0]: 0.5}, stop_time=0.4, output_interval=T
    )
    sent = found[next(name for name in found.dtype.names if name not in ("time", "flags"))]
    assert sent[0] == pytest.approx(-RATE * T)
    assert np.abs(np.diff(sent)).max() < RATE * T * (1 + 1e-9)
    assert sent[:4] == pytest.approx(-RATE * T * np.arange(1, 5))
    assert not about.coSimulation.canHandleVariableCommunicationStepSize
