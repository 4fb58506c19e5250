"""Structures of laws on the command line: options, the spec's [law], and what is refused."""

import argparse
import shlex
from importlib import import_module

import pytest

from polefence import InputError, Structure
from polefence.cli.main import main
from polefence.cli.options import method_arguments, structure_arguments, structure_of
from polefence.examples import spec_text
from polefence.plant.spec import load
from support.commands import refused
from support.memories import design, exported

LAW = '\n[law]\nmeasured = ["tyre deflection"]\ndegree = 2\n'
MEASURED = "suspension deflection, sprung-mass velocity"


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "car.toml"
    path.write_text(spec_text("quarter-car-ride"))
    return path


def asked(spec, *words, method=None):
    parser = argparse.ArgumentParser()
    method_arguments(parser)
    structure_arguments(parser)
    options = parser.parse_args(words)
    options.spec, options.method = spec, method
    return structure_of(load(spec), options)


def test_where_nothing_is_asked_there_is_none(spec):
    assert asked(spec) is None


def test_options_say_what_the_spec_does(spec):
    words = ["--measured", MEASURED, "--schedule", "m1,beta", "--degree", "3", "--order", "2"]
    found = asked(spec, *words, "--largest-gain", "1e5")
    assert found == Structure(
        ("suspension deflection", "sprung-mass velocity"), ("m1", "beta"), 3, 1e5, order=2
    )
    assert asked(spec, "--schedule", "none") == Structure(schedule=())


def test_options_take_the_place_of_the_specs_key_by_key(spec):
    spec.write_text(spec.read_text() + LAW)
    assert asked(spec) == Structure(("tyre deflection",), degree=2)
    assert asked(spec, "--degree", "0") == Structure(("tyre deflection",), degree=0)
    assert asked(spec, "--measured", "suspension deflection").degree == 2


def test_a_method_is_of_all_states(spec):
    spec.write_text(spec.read_text() + LAW)
    assert asked(spec, method="quadratic") is None
    assert asked(spec, "--degree", "2", method="scheduled") is None
    with pytest.raises(InputError, match="--largest-gain applies to laws of a structure; leave it"):
        asked(spec, "--largest-gain", "3", method="scheduled")


WRONG = {
    ("--measured", "tyre deflexion"): "no signal 'tyre deflexion'; did you mean 'tyre deflection'?",
    ("--measured", "actuator force"): "an input passes straight into 'actuator force'",
    ("--measured", "a * 2"): "names have no numbers here",
    ("--measured", "a,"): "cannot read",
    ("--schedule", "m3"): "schedule: no parameter 'm3'",
    ("--order", "-1"): "order = -1 must be 0 to 20",
    ("--degree", "9", "--schedule", "m1"): "degree = 9 must be 0 to 8",
    ("--largest-gain", "-1"): "largest_gain = -1.0 must be a positive number",
    ("--order", "19", "--degree", "2"): "free numbers; at most 500 are tuned",
}


@pytest.mark.parametrize(("words", "said"), WRONG.items())
def test_what_cannot_be_is_said_in_one_line(words, said, spec):
    with pytest.raises(InputError) as caught:
        asked(spec, *words)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


FAULTS = {
    '[sensor."tyre deflexion"]\nbandwidth = 9': "no signal 'tyre deflexion'; did you mean 'tyre",
    '[sensor."tyre deflection"]\nnoise = 9': "noise without a bandwidth has no rms",
    '[sensor."tyre deflection"]': "bandwidth is missing",
    '[sensor."tyre deflection"]\nbandwidth = -9': "bandwidth = -9 must be a positive number",
    '[sensor."tyre deflection"]\nbandwidth = "9 Hz"': "bandwidth = '9 Hz' must be a finite number",
    '[sensor."tyre deflection"]\nbandwith = 9': "unknown key 'bandwith'; did you mean 'bandwidth'",
    '[sensor."tyre deflection"]\nbandwidth = 9\nnoise = -1': "noise = -1 must be a positive number",
    '[sensor."tyre deflection"]\nbandwidth = 9\n[sensor."tyre deflection [m]"]\nbandwidth = 9':
        "has a sensor already",
    '[sensor."tyre deflection"]\nbandwidth = 9\n[sensor."tyre deflection"]\nbandwidth = 9':
        "not valid TOML",
    "sensor = 3": "sensor must be a table",
    "[sensor]\nx = 3": "sensor.'x' must be a table",
    "[actuator.force]\nbandwidth = 9": "no input 'force'; known: actuator force",
    '[actuator."actuator force"]\nbandwidth = 0': "bandwidth = 0 must be a positive number",
    '[actuator."actuator force"]\norder = 2': "bandwidth is missing",
    '[actuator."actuator force"]\nbandwidth = 9\norder = 3': "order = 3 must be 1 or 2",
    '[actuator."actuator force"]\nbandwidth = 1e99\norder = 2': "is out of range",
    "law = 1": "law must be a table",
}  # fmt: skip


@pytest.mark.parametrize(("text", "said"), FAULTS.items())
def test_hardware_that_cannot_be_gets_one_line_and_exit_2(text, said, tmp_path, capsys):
    path = tmp_path / "car.toml"
    # before the first table, as keys at the top must be
    own = spec_text("quarter-car-ride")
    path.write_text(f"{text}\n{own}" if not text.startswith("[") else f"{own}\n{text}\n")
    said_line = refused(capsys, "design", path, "--disk", "-40", "36")
    assert said_line.startswith(f"polefence: {path}: ")
    assert said in said_line


def test_noise_of_a_disturbance_that_is_not_there(tmp_path, capsys):
    path = tmp_path / "car.toml"
    path.write_text('noise = ["rod velocity"]\n' + spec_text("quarter-car-ride"))
    assert main(["design", str(path), "--disk", "-40", "36"]) == 2
    assert "noise: no disturbance 'rod velocity'; did you mean" in capsys.readouterr().err


SPRING = """
name = "spring"
states = ["position [m]", "speed [m/s]"]
inputs = ["force [N]"]
parameter.m = {{range = [1, 2], unit = "kg", through = "1/m"}}
parameter.k = {{range = [4, 20], unit = "N/m"}}
matrices.A = [[0, 1], ["-k/m", "-{damping}/m"]]
matrices.B = [[0], ["1/m"]]
"""
PID = '[law]\nmeasured = ["position"]\nkind = "pid"\nderivative_bandwidth = 2\n'


@pytest.mark.parametrize("kind", ["affine", "one gain", "pid"])
def test_a_file_of_a_law_with_states_of_its_own_is_about_its_spec(kind, tmp_path, capsys):
    design(kind).save(tmp_path / "design")
    exported(kind, 64).save(tmp_path / "code")
    spec = tmp_path / "spring.toml"
    for damping, status in ((0.5, 0), (0.51, 1)):
        spec.write_text(SPRING.format(damping=damping) + PID * (kind == "pid"))
        for file in ("design", "code"):
            assert main(["check", str(tmp_path / file), "--spec", str(spec)]) == status
            assert ("A[2][2] = -0.5, spec -0.51" in capsys.readouterr().out) is bool(status)


def test_a_law_of_another_kind_than_that_of_the_spec_is_about_it_too(tmp_path):
    design("affine").save(tmp_path / "design")
    spec = tmp_path / "spring.toml"
    spec.write_text(SPRING.format(damping=0.5) + PID)
    assert main(["check", str(tmp_path / "design"), "--spec", str(spec)]) == 0


SENSORS = """
[sensor."suspension deflection"]
bandwidth = 100
[sensor."sprung-mass velocity"]
bandwidth = 100
"""


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (
            ["suspension deflection", "sprung-mass velocity [m/s]", "tyre deflection"],
            "takes 'suspension deflection' and 'sprung-mass velocity [m/s]' without the sensor's "
            "bandwidth and noise; write 'measured suspension deflection' and 'measured "
            "sprung-mass velocity' for what the sensor says\n",
        ),
        (["measured suspension deflection", "measured sprung-mass velocity"], ""),
        (["tyre deflection"], ""),
    ],
)
def test_a_signal_measured_past_its_sensor_is_noted(names, said, spec, capsys):
    spec.write_text(spec.read_text() + SENSORS)
    asked(spec, "--measured", ", ".join(names).replace(" [m/s]", ""))
    option = said.replace(" [m/s]", "")
    assert capsys.readouterr().out == (option and f"note: --measured {option}")
    spec.write_text(spec.read_text() + f"[law]\nmeasured = {names}\n")
    asked(spec)
    assert capsys.readouterr().out == (said and f"note: {spec}: law: measured {said}")
    asked(spec, method="quadratic")  # of all states, the sensors' too
    assert not capsys.readouterr().out


PAST = "the sensor's bandwidth and noise; write 'measured suspension deflection'"
# A command, and where its search begins.
SEARCHES = {
    "optimise": "polefence.cli.optimise.optimise",
    "tradeoff --over 'rms of actuator force' --value 600": "polefence.cli.tradeoff.tradeoff",
    "design --region half_plane(0)": "polefence.cli.design.place",
    "tightest --of half_plane": "polefence.cli.tightest.tightest",
    "compare": "polefence.search.optimise.optimise",
    "observe --disk -40 36 --measured '{}'": "polefence.cli.observe.observe",
    "concepts --measured '{}'": "polefence.vehicle.concepts.concepts",
}


@pytest.mark.parametrize("signal", ["suspension deflection", "measured suspension deflection"])
@pytest.mark.parametrize(("words", "search"), SEARCHES.items())
def test_every_search_notes_it_before_it_begins(
    words, search, signal, tmp_path, capsys, monkeypatch
):
    def begun(*_, **__):
        raise InputError("begun")

    path = tmp_path / "car.toml"
    if "concepts" in words:
        path.write_text(spec_text("semi-active") + SENSORS)
    else:
        path.write_text(spec_text("van").replace('"measured suspension deflection"', f'"{signal}"'))
    module, _, name = search.rpartition(".")
    monkeypatch.setattr(import_module(module), name, begun)
    command, *options = shlex.split(words.format(signal))
    assert main([command, str(path), *options]) == 2
    said = capsys.readouterr()
    assert said.err == "polefence: begun\n"
    assert said.out.count("note: ") == said.out.count(PAST) == (not signal.startswith("measured"))
