"""What Python shows of values: names, one short line, tables for notebooks and pandas; copies."""

import copy
import dataclasses
import json
import pickle
from fractions import Fraction
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas
import pytest

import polefence as pf
from polefence.base.frozen import Frozen
from polefence.examples import spec_text
from polefence.proof.short import Short, short, within

MOST = 200
LONG = "n" * 200  # the longest name that there may be


STUDY = """
name = "two"
base = "car.toml"

[variants]
grid = {m2 = [35, 36]}

[[question]]
ask = "tightest"
of = "disk"
centre = -40
method = "quadratic"
"""


@pytest.fixture(scope="module")
def plant():
    k, c = pf.Parameter("k", 1, 2, "N/m"), pf.Parameter("c", 0.4, 0.6, "N s/m")
    made = pf.UncertainPlant.from_expressions(
        [k, c],
        [[0, 1], ["-k", "-c"]],
        [[0], [1]],
        [[0], [1]],
        name=LONG,
        states=("place [m]", "speed [m/s]"),
        inputs=("force [N]",),
        disturbances=("push [N]",),
    )
    return dataclasses.replace(made, name=LONG)


@pytest.fixture(scope="module")
def values(plant, tmp_path_factory):
    """Small examples of what the package returns, by name."""
    region = pf.parse_region(
        "half_plane(0.3) & disk(-5, 20) & sector(0.1) & vertical_strip(-30, 0)"
    )
    design = pf.place(plant, pf.HalfPlane(0.5))
    least, limit = pf.Rms("place"), pf.Rms("force", at_most=5.0)
    found = pf.optimise(plant, least, [limit], structure=pf.Structure(schedule=()))
    front = pf.tradeoff(plant, least, limit, [5.0], methods=["quadratic"])
    folder = tmp_path_factory.mktemp("study")
    (folder / "car.toml").write_text(spec_text("quarter-car-m1"))
    (folder / "study.toml").write_text(STUDY)
    study = pf.fleet.load_study(folder / "study.toml")
    car = pf.load(folder / "car.toml")
    table = pf.GainTable(
        plant.parameters, {"k": [1, 2], "c": ["0.4", "0.6"]}, np.tile([[-1.0, -1.0]], (2, 2, 1, 1))
    )
    gain = [[-1.0, -1.0]]
    return {
        "plant": plant,
        "parameter": plant.parameters[0],
        "system": plant.vertices[0],
        "regions": region,
        "region": pf.Disk(-40, 31),
        "ellipse": pf.Ellipse(-5, 3, 2),
        "design": design,
        "certificate": design.certificate,
        "claim": design.certificate.claim(),
        "document": design.certificate.file(),
        "check": pf.check(design),
        "scheduled": design.law,
        "fixed": pf.FixedGain(np.ones((3, 40)) / 3),
        "polynomial": found.law,
        "table": table,
        "optimised": found,
        "bound": found.bounds[0],
        "claim of a bound": found.bounds[0].claim,
        "specification": least,
        "gain norm": pf.GainNorm(at_most=5.0),
        "saturation": pf.Saturation("force", points=((1.0, 0.0),), at_most=1.0),
        "structure": pf.Structure(measured=("place", "speed"), schedule=()),
        "limit": pf.limits(plant, [-3.0], ["quadratic"], bounds=False)[0],
        "front": front,
        "study": study,
        "variants": study.variants,
        "margins": pf.in_service(design),
        "analysis": pf.analyse(plant, gain, pf.HalfPlane(0.1), limits=[limit]),
        "worst case": pf.worst_case(plant, gain),
        "comparison": pf.vehicle.compare(car, {"passive": None}),
        "pencil": pf.build("quadratic", plant.A, plant.B, 3.0),
        "scheduled method": pf.Scheduled(2, 1, "box"),
        "output": pf.response.states(plant)[0],
        "response": pf.response.step(plant, gain, [[0.25] * 4]),
        "ride": pf.vehicle.ride(car),
        "hardware": pf.vehicle.Hardware(),
    }


SHOWN = (
    "plant", "region", "regions", "ellipse", "design", "scheduled", "fixed", "polynomial", "table",
    "optimised", "bound", "limit", "front", "study", "margins", "analysis",
    "comparison",
)  # fmt: skip


def test_dir_lists_what_there_is_and_nothing_else():
    assert dir(pf) == sorted(pf.__all__)
    assert {"place", "optimise", "Rms", "vehicle"} <= set(dir(pf))
    assert not {"Any", "TYPE_CHECKING", "import_module"} & set(dir(pf))


def _reached(value, seen):
    """All dataclasses that a value is made of."""
    if isinstance(value, tuple | list):
        for own in value[:5]:
            _reached(own, seen)
    if isinstance(value, dict):
        _reached(list(value.values()), seen)
    if dataclasses.is_dataclass(value) and type(value) not in seen:
        seen[type(value)] = value
        for own in dataclasses.fields(value):
            _reached(getattr(value, own.name, None), seen)


def test_every_value_and_what_it_is_made_of_is_one_short_line(values):
    seen: dict[type, object] = {}
    _reached(list(values.values()), seen)
    for own in values.values():
        _reached(own, seen)
    assert len(seen) > 45
    for kind, own in seen.items():
        assert len(repr(own)) <= MOST, kind
        assert "\n" not in repr(own), kind
    for name, own in values.items():
        assert len(repr(own)) <= MOST, name


def test_every_dataclass_of_the_facade_is_cut_whatever_it_holds():
    kinds = [getattr(pf, name) for name in pf.__all__]
    kinds += [getattr(room, name) for room in (pf.vehicle, pf.response, pf.fleet, pf.export)
              for name in room.__all__]  # fmt: skip
    found = [own for own in kinds if isinstance(own, type) and dataclasses.is_dataclass(own)]
    assert len(found) > 60
    for kind in found:
        assert issubclass(kind, Short), kind


def test_a_short_line_says_what_it_can():
    assert repr(pf.Disk(-40, 31)) == "Disk(centre=-40.0, radius=31.0)"
    assert repr(pf.Rms("x1")) == "Rms(signal='x1')"  # of what has its default nothing
    assert eval(repr(pf.Rms("x1", at_most=2.0)), {"Rms": pf.Rms}) == pf.Rms("x1", at_most=2.0)
    system = pf.System([[0, 1], [2, 3]], [[0], [1]])
    assert repr(system) == f"<System {system.name!r}: 2 states, 1 inputs>"
    assert short(np.zeros((3, 4))) == "<array 3 x 4>"
    assert short(tuple(range(100))) == "<tuple of 100>"
    assert short(Fraction(10**400, 7)) == "<Fraction beyond 1e308>"
    assert short(Fraction(1, 3)) == "Fraction(1, 3)"
    assert len(short("word " * 100)) <= MOST
    assert within("<" + "x" * 300 + ">").endswith("...>")


class Pairs(HTMLParser):
    """Whether each tag ends, and no other tags are there."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.seen.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_shows_a_table(values, name):
    text = values[name]._repr_html_()
    own = Pairs(text)
    assert not own.open
    assert own.seen - {"img"} == {"table", "caption", "b", "tr", "th", "td"}


def test_no_name_in_a_table_is_markup(plant):
    named = dataclasses.replace(plant, name="<script>alert(1)</script>")
    for own in (named, pf.analyse(named, [[-1.0, -1.0]], pf.HalfPlane(0.1))):
        assert "<script>" not in own._repr_html_()


@pytest.mark.parametrize("name", ["design", "certificate", "limit", "optimised", "bound", "front",
                                  "scheduled", "fixed", "polynomial", "table", "plant", "regions",
                                  "margins", "analysis", "comparison", "study",
                                  "check", "claim", "document", "structure"])  # fmt: skip
def test_values_are_copied_sent_and_turned_into_dicts(values, name):
    own = values[name]
    for other in (copy.deepcopy(own), pickle.loads(pickle.dumps(own))):
        assert type(other) is type(own)
        assert repr(other) == repr(own)
    fields = {each.name for each in dataclasses.fields(own)}
    assert set(dataclasses.asdict(own)) == fields


def test_a_copy_of_a_design_proves_itself(values):
    other = pickle.loads(pickle.dumps(values["design"]))
    assert pf.check(copy.deepcopy(other)).proved
    assert other.certificate.evidence == values["design"].certificate.evidence


def test_evidence_is_read_only(values):
    evidence = values["design"].certificate.evidence
    for change in (
        lambda: evidence.update(tau=1),
        lambda: evidence.pop("tau"),
        lambda: evidence.__setitem__("tau", 1),
        lambda: evidence.__delitem__("tau"),
        lambda: evidence.setdefault("new", 1),
        evidence.clear,
        evidence.popitem,
    ):
        with pytest.raises(TypeError, match="read-only"):
            change()
    assert dict(evidence) == evidence
    assert type(copy.deepcopy(evidence)) is Frozen


# --- tables of pandas -----------------------------------------------------------------------------


def _is_plain(frame):
    kinds = {type(x) for column in frame.columns for x in frame[column].tolist()}
    return kinds <= {int, float, str, bool, type(None)}


def test_limits_are_rows_of_pandas(plant):
    found = pf.limits(plant, [-3.0, -4.0], ["quadratic", "slack"], bounds=False)
    frame = pandas.DataFrame(found)
    assert list(frame.columns[:3]) == ["centre", "method", "radius"]
    assert frame["radius"].tolist() == [own.radius for own in found]
    assert _is_plain(frame)
    assert found[0].design.region == pf.Disk(-3.0, found[0].radius)  # still there


def test_the_law_of_a_limit_stays_with_it_when_it_is_changed(values):
    own = values["limit"]
    assert dataclasses.replace(own, lower=1.0, found=own.design).design is own.design


def test_a_tradeoff_is_rows_of_pandas(values):
    front = values["front"]
    frame = pandas.DataFrame(front.as_rows())
    assert _is_plain(frame)
    assert frame["proved"].tolist() == [row["proved"] for row in front.rows]
    assert frame["proved rms of force"].tolist() == [
        row["bounds"][0]["proved"] for row in front.rows
    ]
    json.dumps(front.as_rows(), allow_nan=False)


def test_a_comparison_is_rows_of_pandas(values):
    own = values["comparison"]
    frame = pandas.DataFrame(own.as_rows())
    assert _is_plain(frame)
    row = own.row("passive")
    first = frame[frame["quantity"] == "weighted acceleration"].iloc[0]
    assert first["worst"] == row.worst
    assert first["m1"] == row.values["m1"]


def test_a_study_is_rows_of_pandas(tmp_path):
    (tmp_path / "car.toml").write_text(spec_text("quarter-car-m1"))
    (tmp_path / "study.toml").write_text(STUDY)
    rows = pf.study(tmp_path / "study.toml", tmp_path / "out", workers=pf.fleet.processes(1))
    frame = pandas.DataFrame(rows)
    assert len(frame) == 2
    assert _is_plain(frame)
    assert Path(tmp_path / "out").is_dir()
