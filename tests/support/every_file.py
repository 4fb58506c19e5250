"""One file of every kind that the commands write, of a small plant."""

import contextlib
import io
import json
import shutil
from pathlib import Path

import numpy as np

from polefence.certify import bounds
from polefence.certify.candidates import Deadline
from polefence.certify.design import Design
from polefence.certify.evidence import Search, certificate_of
from polefence.certify.given import analyse
from polefence.certify.margins.gain_scales import gain_claim
from polefence.cli.main import main
from polefence.law.laws import PolynomialGain
from polefence.plant.spec import load
from polefence.region.regions import HalfPlane, Sector
from polefence.requirements.bump import BumpMeasure
from polefence.requirements.disk_margin import DiskMargin, Unmodelled
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.free import ImpulseMeasure, InitialMeasure
from polefence.requirements.gain import Gain
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.peak_to_peak import PeakToPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.sector import SectorBound
from polefence.requirements.step import StepMeasure
from polefence.requirements.worst_gain import WorstCaseGain
from support.specs import CROSSED

EARLIER = Path(__file__).parents[1] / "proof" / "format2" / "one-gain-1.json"
SPEC = """name = "mass"
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
region = "disk(-3, 2.5)"
[constants]
c = 1
[parameter.k]
range = [1, 2]
unit = "N/m"
through = "k"
[definitions]
s = "k + c"
[matrices]
A = [[0, 1], ["-s", "-c"]]
B = [[0], [1]]
E = [[0], [1]]
"""
ASKED = """[road]
class = "C"
speed = 20
[[specification]]
kind = "rms"
signal = "x"
density = 1
minimise = true
[[specification]]
kind = "initial peak"
signal = "u"
at_most = 50
points = [[1, 0]]
[[specification]]
kind = "gain norm"
at_most = 50
rows = [1]
columns = [1, 1]
"""
TWO = """name = "two"
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["road [m/s]", "wind [N]"]
[parameter.k]
range = [1, 2]
unit = "N/m"
[outputs]
"a [m/s2]" = {C = ["-k", -1], D = [1], F = [0, 1]}
[matrices]
A = [[0, 1], ["-k", -1]]
B = [[0], [1]]
E = [[1, 0], [0.5, 1]]
[[specification]]
kind = "rms"
signal = ["x", "a"]
density = 1
disturbances = {road = 0.5}
minimise = true
[[specification]]
kind = "gain"
signal = ["x", "a", "u"]
disturbances = {road = 0.25, wind = 2}
at_most = 40
[[specification]]
kind = "energy peak"
signal = "x"
disturbances = ["wind"]
at_most = 40
"""
OBSERVE = ["observe", "plain.toml", "--measured", "x", "--disk", "-6", "5"]
EVERY_KIND = [
    word
    for limit in (
        "rms of u <= 50 with density 1",
        "relative rms of x <= 0.95 with density 1",
        "energy peak of v <= 20 with norm 1",
        "initial peak of x <= 5 with impulse 1",
        "gain of v <= 10",
    )
    for word in ("--limit", limit)
]
# Of claims, with every kind of them.
FILES = (
    "quadratic/design.json", "scheduled/design.json", "slack/design.json", "lyapunov/design.json",
    "table/table.json", "service/estimate-k.json", "service/gain.json", "service/rate-k.json",
    "performance/design.json", "signals/design.json", "vectors/design.json", "code/guarantee.json",
    "observer/design.json", "observed/guarantee.json", "tuned/design.json", "parts/design.json",
    "cells/design.json", "damper/law.json", "damper/limit.json", "late/design.json",
    "discrete/design.json", "moving/design.json", "whole/gain.json", "code/sampled.json",
    "earlier/sampled.json", "half/design.json", "clock/design.json", "started/design.json",
    "passing/design.json", "margins/design.json", "failing/margins.json", "delayed/design.json",
    "apart/design.json", "least/limit.json",
)  # fmt: skip
PASSING = (
    SPEC
    + """[outputs]
"error" = {C = [1, 0], F = [0.5]}
"slip" = {C = ["k", 1], F = [-0.25]}
"""
)
DAMPER = """name = "damped"
states = ["d [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
[matrices]
A = [[0, -1], [2, 0]]
B = [[0], [1]]
E = [[0], [1]]
[damper.u]
deflection = "d"
range = [1, 4]
[[specification]]
kind = "rms"
signal = ["d", "u"]
density = 1
minimise = true
"""
DISCRETE = """name = "cart"
sample_time = 0.1
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
[parameter.k]
range = [1, 2]
unit = "N/m"
[matrices]
A = [[1, 0.1], ["-0.1*k", 0.8]]
B = [[0], [0.1]]
E = [[0], [0.1]]
"""
LAG = """name = "lag"
states = ["x"]
inputs = ["u"]
disturbances = ["w"]
[parameter.a]
range = [0.8, 1.2]
[matrices]
A = [["a"]]
B = [[1]]
E = [[1]]
[[specification]]
kind = "rms"
signal = "x"
density = 2
at_most = 5
"""
BOTH = (
    LAG
    + """[[specification]]
kind = "saturation"
signal = ["u", "rate of u"]
limits = [4, 40]
points = [[1]]
"""
)
STARTS = (
    SPEC
    + """[[specification]]
kind = "initial peak"
signal = "x"
points = [[1, 0], [0, 1]]
at_most = 5
[[specification]]
kind = "initial peak"
signal = "v"
ellipsoid = [[1, 0], [0, 0.5]]
at_most = 5
"""
)
LATE = [
    "optimise", "plain.toml", "--sample-time", "0.05", "--delay", "1", "--method", "quadratic",
    "--limit", "rms of u <= 50 with density 1", "--limit", "energy peak of v <= 20 with norm 1",
    "--limit", "gain of v <= 10", "--region", "half_plane(0.3)",
]  # fmt: skip
HALF = [
    "verify", "both.toml", "--gain", "[[-3, 0]]", "--region", "disk(0, 1)", "--sample-time", "0.1",
    "--delay", "0.5",
]  # fmt: skip
LEAST = [
    "optimise", "plain.toml", "--method", "quadratic", "--minimise", "gain of [x, u]",
    "--limit", "gain of v <= 0.9",
]  # fmt: skip
CLOCK = [
    "verify", "plain.toml", "--gain", "[[-3, -3]]", "--region", "disk(0, 1)", "--sample-time",
    "0.05", "--jitter", "0.1", "--limit", "rms of x <= 5 with density 1",
]  # fmt: skip
STARTED = [
    "verify", "starts.toml", "--gain", "[[-3, -4]]", "--region", "disk(0, 1)", "--sample-time",
    "0.1",
]  # fmt: skip
MOVING = [
    "optimise", "moving.toml", "--limit", "rms of u <= 50 with density 1",
    "--limit", "energy peak of v <= 20 with norm 1", "--limit", "gain of v <= 10",
    "--limit", "initial peak of x <= 5 with impulse 1",
    "--limit", "saturation of u <= 3 with norm 1", "--region", "disk(-3, 2.9) & half_plane(0.3)",
]  # fmt: skip
RUN = ["--sample-time", "0.001", "--float", "32"]
LIMITS = [
    "limits", "plain.toml", "--centre", "-3", "--method", "quadratic", "--json", "limits.json",
    "--resume",
]  # fmt: skip
TRADEOFF = [
    "tradeoff", "spec.toml", "--over", "rms of u with density 1", "--value", "20", "--method",
    "quadratic", "--json", "tradeoff.json", "--resume",
]  # fmt: skip


def quiet(words):
    """The exit status of a command, and what it said."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except SystemExit as stop:
            status = stop.code
    return status, out.getvalue(), err.getvalue()


MARGINS = (
    "verify", "plain.toml", "--gain", "[[-3, -3]]", "--region", "half_plane(0.3)",
    "--limit", "disk margin of u >= 1", "--limit", "disk margin of [u, x, v] with sigma 0.5",
    "--limit", "unmodelled dynamics of u with weight (2*s+1)/(s+5)",
    "--limit", "gain margin of u >= 5", "--limit", "phase margin of x >= 30",
    "--limit", "gain of [v, x] with band [1, 2]",
    "--limit", "delay margin of u",
    "--limit", "worst-case gain of [x, u] with inputs [u] with weight (s+1)/(s+5)",
    "--limit", "sector of x with disturbance [w] with sector [-1, 2]",
    "--limit", "sector of x with disturbance [w] with sector [-2, 2] with time_invariant true",
    "--limit", "sector of x with disturbance [w] with sector [-2, 1] with slope_restricted true",
    "--limit", "step of x with measure settling with band 0.05",
    "--limit", "step of v with measure peak", "--limit", "peak to peak of x",
    "--limit", "initial of x from [x * 0.5, v * -1] with measure settling with band 0.05",
    "--limit", "impulse of x with measure peak",
    "--limit", "bump of x with height 0.5 with length 2 with speed 1 with acts rate",
)  # fmt: skip

APART = [
    "verify", "crossed.toml", "--gain", "[[0, 0]]", "--region", "half_plane(0)",
    "--limit", "unmodelled dynamics of [v1 -> w1, v2 -> w2] with weight 1 >= 0.4",
    "--limit", "worst-case gain of [v1, v2] <= 8 with inputs [v1 -> w1, v2 -> w2] with weight 0.3 "
    "with time_invariant true", "-o", "apart",
]  # fmt: skip
LATE_SAMPLES = [
    "verify", "discrete.toml", "--gain", "[[-3, -3]]", "--limit", "delay margin of u",
    "-o", "delayed",
]  # fmt: skip

FAILING = (
    "robust", "plain.toml", "--gain", "[[-3, -3]]", "--region", "half_plane(0.3)",
    "--limit", "disk margin of [u, x] with sigma 0.5",
    "--limit", "unmodelled dynamics of u with weight (2*s+1)/(s+5)",
    "--limit", "sector of x with disturbance [w] with sector [-1, 2]",
)  # fmt: skip


def write_every_file(made: Path) -> None:
    """Write the files into the working folder, each of them proved."""
    (made / "plain.toml").write_text(SPEC)
    (made / "spec.toml").write_text(SPEC + ASKED)
    (made / "two.toml").write_text(TWO)
    (made / "damper.toml").write_text(DAMPER)
    (made / "both.toml").write_text(BOTH)
    (made / "starts.toml").write_text(STARTS)
    (made / "discrete.toml").write_text(DISCRETE)
    (made / "passing.toml").write_text(PASSING)
    (made / "crossed.toml").write_text(CROSSED)
    (made / "moving.toml").write_text(SPEC.replace('through = "k"', "rate = [-1, 2]"))
    knots = {"grid": {"k": [1, 2]}, "gains": [[[-3, -3]], [[-3, -3]]]}
    (made / "gains.json").write_text(json.dumps(knots))
    half = ["--region", "half_plane(0.3)"]
    design = ["design", "plain.toml", "--disk", "-3", "2.5", "--method"]
    for words in (
        [*design, "quadratic", "-o", "quadratic"],
        [*design, "scheduled", "-o", "scheduled"],
        [*design, "slack", "-o", "slack"],
        ["analyse", "plain.toml", "--gain", "[[-3, -3]]", *half, "-o", "lyapunov"],
        ["analyse", "plain.toml", "--gain", "gains.json", *half, "-o", "table"],
        ["service", "scheduled", "-o", "service"],
        [*MARGINS, "-o", "margins"],
        [*FAILING, "-o", "failing"],
        ["optimise", "spec.toml", "--method", "quadratic", "-o", "performance"],
        ["optimise", "plain.toml", "--method", "quadratic", *EVERY_KIND, "-o", "signals"],
        [*LEAST, "-o", "least"],
        ["optimise", "two.toml", "--method", "quadratic", "-o", "vectors"],
        [*LATE, "-o", "late"],
        [*CLOCK, "-o", "clock"],
        [*STARTED, "-o", "started"],
        [*MOVING, "-o", "moving"],
        [*HALF, "-o", "half"],
        ["optimise", "discrete.toml", "--method", "quadratic", *EVERY_KIND, "-o", "discrete"],
        LATE_SAMPLES,
        APART,
        ["export", "quadratic", "-o", "code", "--sample-time", "0.001"],
        [*OBSERVE, "-o", "observer"],
        ["export", "scheduled", "-o", "observed", "--observer", "observer", *RUN],
        ["semi-active", "damper.toml", "--degree", "4", "-o", "damper"],
        LIMITS[:-1],
        TRADEOFF[:-1],
    ):
        assert quiet(words)[0] == 0, words
    _write_polynomial(made)
    _write_passing(made)
    _write_gain_error(made)
    (made / "earlier").mkdir()  # of a claim that no command writes any more
    shutil.copy(EARLIER, made / "earlier" / "sampled.json")


def _write_polynomial(made: Path) -> None:
    """Write files of a polynomial law: with polynomials of the box, and of its parts."""
    plant = load(made / "plain.toml")
    measured = plant.signal("v"), plant.signal("x")
    gains = [[[-3, -4]], [[0.25, -0.5]]]
    law = PolynomialGain(((0,), (1,)), gains, measured, plant.parameters)
    certificate = analyse(plant, law, HalfPlane(0.3)).design.certificate
    kinds = Rms("x", density=1), Gain("x"), RelativeRms("x")
    asked = [bounds._Question.of(plant, law, own) for own in kinds]
    whole = [next(bounds._dual_bounds(own)).claim for own in asked]
    bounds.save(certificate, whole, made / "tuned")
    near = asked[0].in_parts(asked[0].worst * (1 + 1e-7))
    assert near is not None
    assert len(near.claim.subject.evidence.cells) > 1
    bounds.save(certificate, [near.claim], made / "parts")
    both = HalfPlane(0.3), Sector(0.1)
    each = [Search(plant, law, part, Deadline()).in_parts() for part in both]
    Design(certificate_of(plant, law, both[0] & both[1], each)).save(made / "cells")


def _write_passing(made: Path) -> None:
    """Write a file of a law into whose signals a disturbance passes straight."""
    plant = load(made / "passing.toml")
    measured = plant.signal("error"), plant.signal("slip")
    law = PolynomialGain(((0,), (1,)), [[[-3, -4]], [[0.25, -0.5]]], measured, plant.parameters)
    certificate = analyse(plant, law, HalfPlane(0.3)).design.certificate
    kinds = (
        Rms("x", density=1), Gain(["x", "u"]), RelativeRms("v"), EnergyPeak("v", norm=1),
        InitialPeak("x", impulse=1), DiskMargin("u"), DiskMargin(["u", "slip"]),
        WorstCaseGain("x", inputs="u", weight="(s + 1)/(s + 9)"),
        SectorBound("x", disturbance="w", sector=(-0.2, 0.5)),
        SectorBound("v", disturbance="w", sector=(-0.2, 0.5), slope_restricted=True),
        StepMeasure("v", measure="peak"), PeakToPeak("v", disturbances={"w": 0.5}),
        StepMeasure("x", envelope=[[0, -1, 2], [9, -1, 1]]), InitialMeasure("v", start={"x": 1.0}),
        ImpulseMeasure("x"),
        BumpMeasure("v", height=0.5, length=2, speed=1, acts="height", late={"w": 0.25}),
        WorstCaseGain(
            "v", inputs=["u", "slip -> w"], weight="0.3*(s + 1)/(s + 9)", time_invariant=True
        ),
        Unmodelled("slip -> w", weight="0.3"),
    )  # fmt: skip
    proved = [bounds.best_bound(plant, law, own) for own in kinds]
    dual = bounds._Question.of(plant, law, kinds[0])
    proved.append(next(bounds._dual_bounds(dual)))
    bounds.save(certificate, [own.claim for own in proved], made / "passing")


def _write_gain_error(made: Path) -> None:
    """Write a file of an error of the gain as a whole, as `service` once wrote them."""
    design = Design.load(made / "scheduled")
    largest, claim = gain_claim(design, np.ones(1), np.ones(2), 0.0)
    assert claim is not None
    assert 0 < claim.error < largest
    (made / "whole").mkdir()
    (made / "whole" / "gain.json").write_text(design.certificate.file([claim]).dumps())
