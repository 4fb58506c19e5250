"""Measurements in files: what is written comes back, and each fault is one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

import polefence as pf
from polefence.cli.main import main
from polefence.data import load_measurements
from support.measurements import BAND, POINTS, at, companion, in_frequency, in_time, names

HEAD = """name = "two masses"
order = 2
inputs = ["u0 [N]"]
outputs = ["y0 [m]"]
[parameter.q]
unit = "kg"
label = "load"
"""


def measurement(name, q):
    return f'[[measurement]]\nfile = "{name}"\nat = {{q = {q:g}}}\n'


def write_csv(path, head, columns, separator=","):
    rows = [separator.join(head)]
    rows += [separator.join(f"{x:.17g}" for x in row) for row in np.array(columns).T]
    path.write_text("# by a logger\n" + "\n".join(rows) + "\n")


@pytest.fixture
def source():
    return np.random.default_rng(0)


@pytest.fixture
def plant(source):
    return companion(2, 1, 1, source)


def timed(folder, plant, source, head=("time [s]", "u0 [N]", "y0 [m]"), separator=","):
    for own in in_time(plant, source):
        columns = [own.time * (1000 if "[ms]" in head[0] else 1), own.inputs[0], own.outputs[0]]
        write_csv(folder / f"{own.at['q']:g}.csv", head, columns, separator)
    text = HEAD + "".join(measurement(f"{q:g}.csv", q) for q in POINTS)
    (folder / "m.toml").write_text(text)
    return text


@pytest.mark.parametrize("head", [("time [s]", "u0 [N]", "y0 [m]"), ("t [ms]", "u0", "y0")])
@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
def test_responses_in_time(head, separator, tmp_path, plant, source):
    timed(tmp_path, plant, source, head, separator)
    found = load_measurements(tmp_path / "m.toml").answer()
    assert found.data.all.largest < 1e-6
    assert found.data.files == ("1.csv", "1.3.csv", "1.6.csv", "2.csv")
    (p,) = found.plant.parameters
    assert (p.name, p.unit, p.label, float(p.low), float(p.high)) == ("q", "kg", "load", 1, 2)


PAIR = "y0 from u0"
FORMS = {
    "parts": lambda G: {f"real part of {PAIR}": G.real, f"imaginary part of {PAIR}": G.imag},
    "size": lambda G: {f"magnitude of {PAIR}": abs(G), f"phase of {PAIR}": np.degrees(np.angle(G))},
    "decibel": lambda G: {f"magnitude of {PAIR} [dB]": 20 * np.log10(abs(G)),
                          f"phase of {PAIR} [rad]": np.angle(G)},
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("unit", "factor"), [("Hz", 2 * np.pi), ("rad/s", 1.0)])
def test_frequency_responses(form, unit, factor, tmp_path, plant):
    for own in in_frequency(plant):
        columns = {f"frequency [{unit}]": BAND / factor, **FORMS[form](own.values[0, 0])}
        write_csv(tmp_path / f"{own.at['q']:g}.csv", list(columns), list(columns.values()))
    text = HEAD + "".join(measurement(f"{q:g}.csv", q) for q in POINTS)
    (tmp_path / "m.toml").write_text(text)
    found = load_measurements(tmp_path / "m.toml").answer()
    assert found.data.all.largest < 1e-6
    assert found.data.kind == "frequency"


def test_columns_of_other_names(tmp_path, plant, source):
    text = timed(tmp_path, plant, source, ("time [s]", "F_act", '"pos, raw"'))
    (tmp_path / "m.toml").write_text(
        text.replace("[parameter.q]", '[columns]\nu0 = "F_act"\ny0 = "pos, raw"\n[parameter.q]')
    )
    assert load_measurements(tmp_path / "m.toml").answer().data.all.largest < 1e-6


def test_the_command_writes_a_family_that_other_commands_take(
    tmp_path, plant, source, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    timed(tmp_path, plant, source)
    words = ["identify", "m.toml", "-o", "family.toml", "--json", "said.json", "--plot", "fit.svg"]
    assert main(words) == 0
    out = capsys.readouterr().out
    family = pf.load("family.toml")
    assert out.splitlines().count(family.data.note) == 1
    said = json.loads((tmp_path / "said.json").read_text())
    assert said["data"] == family.data.write()
    assert said["plant"]["unproved"] == family.data.note
    assert [row["values"]["q"] for row in said["measurements"]] == list(POINTS)
    assert (tmp_path / "fit.svg").read_text().startswith("<?xml")
    assert main(["design", "family.toml", "--region", "half_plane(3)", "-o", "made"]) == 0
    assert main(["check", "made", "--spec", "family.toml"]) == 0
    assert capsys.readouterr().out.splitlines().count(family.data.note) == 2
    # of a refusal too, and of many variants
    assert main(["design", "family.toml", "--region", "disk(-100, 0.01)"]) == 1
    assert capsys.readouterr().out.splitlines().count(family.data.note) == 1
    (tmp_path / "study.toml").write_text(
        'base = "family.toml"\nvariants.grid = {"q.high" = [1.8, 2]}\n'
        'question = [{ask = "tightest", of = "half_plane"}]\n'
    )
    for words in (
        ["study.toml", "-o", "rows"],
        ["rows", "--html", "rows.html"],
        ["rows", "--check"],
    ):
        assert main(["study", *words]) == 0
        assert capsys.readouterr().out.splitlines().count(family.data.note) == 1
    assert (tmp_path / "rows.html").read_text().count("unproved, from data") == 1
    A, _ = family.at(family.alpha(q=1.7))
    np.testing.assert_allclose(np.poly(A), np.poly(at(plant, 1.7)[0]), rtol=1e-6)


def fault(old, new, said):
    return lambda text: text.replace(old, new, 1), None, said


def cell(line, column, text):
    def change(rows):
        row = rows[line].split(",")
        row[column] = text
        rows[line] = ",".join(row)

    return change


FAULTS = {
    "no TOML": fault("order", "order =", "not valid TOML"),
    "unknown key": fault("order", "ordre", "unknown key 'ordre'; did you mean 'order'"),
    "no order": fault("order = 2\n", "", "order = None must be a whole number"),
    "order in quotes": fault("order = 2", 'order = "2"', "must be a whole number"),
    "degree": fault("order = 2", "order = 2\ndegree = 7", "degree = 7 must be 0, 1 or 2"),
    "unstable": fault("order = 2", 'order = 2\nunstable = "no"', "must be true or false"),
    "hold": fault("order = 2", 'order = 2\nhold = "zero"', "hold = 'zero' is unknown"),
    "inputs": fault('["u0 [N]"]', '"u0 [N]"', "must be a list of names"),
    "no measurement": fault("[[measurement]]", "[[measurements]]", "unknown key 'measurements'"),
    "no file": fault('file = "1.csv"\n', "", "measurement 1: file = None must be text"),
    "a missing file": fault('"1.3.csv"', '"none.csv"', "none.csv: cannot be read: No such file"),
    "a folder": fault('"1.3.csv"', '"."', "is a folder"),
    "at": fault("at = {q = 1}", "at = 1", "measurement 1: at = 1 must be a table"),
    "at in quotes": fault("{q = 1}", '{q = "1"}', "measurement 1: at.q = '1' must be a finite"),
    "at nan": fault("{q = 1}", "{q = nan}", "at.q"),
    "no value": fault("at = {q = 1}\n", "", "1.csv: at has no value of q"),
    "parameter": fault("[parameter.q]", "[parameter.p]", "parameter.p: no measurement has its"),
    "of a parameter": fault('unit = "kg"', "unit = 1", "parameter.q must be a table of texts"),
    "no such column": fault('"y0 [m]"', '"y1 [m]"', "no column 'y1'; known: time, u0, y0"),
    "another unit": fault('"y0 [m]"', '"y0 [mm]"', "column 'y0' is in 'm', the signal in 'mm'"),
    "a name twice": fault('["u0 [N]"]', '["y0"]', "two signals have one name"),
    "nan": (None, cell(5, 2, "nan"), "line 6, column 'y0': 'nan' is no finite number"),
    "a word": (None, cell(5, 1, "off"), "line 6, column 'u0': 'off' is no finite number"),
    "falling": (None, cell(5, 0, "0"), "time does not rise: sample 4 is 0"),
    "a cell too many": (None, cell(5, 2, "1,2"), "line 6 has 4 cells; its header 3"),
    "a decimal comma": (
        None,
        lambda rows: rows.__setitem__(slice(None), [row.replace(",", ";").replace(".", ",")
                                                    for row in rows]),
        "is no finite number; write its decimals behind a point",
    ),
    "no unit": (None, cell(1, 0, "time"), "the first column is 'time'; a response has 'time [s]'"),
    "no name": (None, cell(1, 1, ""), "column 2 has no name"),
    "one name": (None, cell(1, 1, "y0"), "column 3 has the name of another"),
    "two lines": (None, lambda rows: rows.__delitem__(slice(3, None)), "4 to 200000 numbers"),
    "no line": (None, lambda rows: rows.__delitem__(slice(2, None)), "no line of numbers"),
    "too few": (None, lambda rows: rows.__delitem__(slice(7, None)), "20 measured numbers are too"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_one_line(name, tmp_path, plant, source, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    of_text, of_rows, said = FAULTS[name]
    text = timed(tmp_path, plant, source)
    if of_text is not None:
        changed = of_text(text)
        assert changed != text
        (tmp_path / "m.toml").write_text(changed)
    for q in POINTS if of_rows is not None else ():
        path = tmp_path / f"{q:g}.csv"
        rows = path.read_text().splitlines()
        of_rows(rows)
        path.write_text("\n".join(rows) + "\n")
    assert main(["identify", "m.toml", "-o", "family.toml"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not (tmp_path / "family.toml").exists()


def test_the_measurements_are_not_written_over(tmp_path, plant, source, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = timed(tmp_path, plant, source)
    assert main(["identify", "m.toml", "-o", "m.toml"]) == 2
    assert "name another file" in capsys.readouterr().err
    assert (tmp_path / "m.toml").read_text() == text


def test_names_of_signals_are_what_they_were(plant):
    assert names(plant) == {"input_names": ["u0"], "output_names": ["y0"]}


HEADS = {
    "magnitude of y0 from u0 [mm/N]": "'magnitude of y0 from u0' is in 'mm/N', the pair in 'm/N'",
    "magnitude of y0 from u0 [m/N]": None,
    "magnitude of y0 from u0 [m/(N)]": None,
    "magnitude": "has 'phase of y0 from u0' and no 'magnitude of y0 from u0'; a fit needs both",
}


@pytest.mark.parametrize("head", HEADS)
def test_a_frequency_response_has_both_parts_in_the_units_of_its_signals(head, tmp_path, plant):
    for own in in_frequency(plant):
        G = own.values[0, 0]
        write_csv(tmp_path / f"{own.at['q']:g}.csv", ["w [rad/s]", head, f"phase of {PAIR} [rad]"],
                  [BAND, abs(G), np.angle(G)])  # fmt: skip
    (tmp_path / "m.toml").write_text(HEAD + "".join(measurement(f"{q:g}.csv", q) for q in POINTS))
    if HEADS[head] is None:
        assert load_measurements(tmp_path / "m.toml").answer().data.all.largest < 1e-6
        return
    with pytest.raises(pf.InputError) as refused:
        load_measurements(tmp_path / "m.toml")
    assert HEADS[head] in str(refused.value)
    assert "\n" not in str(refused.value)
