"""Names, units and titles of strangers: the C compiles, and nothing leaks out of its comments."""

import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.base.errors import InputError
from polefence.export.sources import WIDTH, block, check_c_name, comment, sources
from polefence.plant.parameters import Parameter
from support.needed import need
from support.shapes_of_laws import BY_LABEL, STRICT, run

SHAPE = BY_LABEL["two parameters, limits"]
LEAK = "int leaked(void);"
HOSTILE = {
    "end": f"*/ {LEAK} /*",
    "end, twice": f"**// {LEAK} //**",
    "end after a backslash": f"*\\ {LEAK} /\\*",  # the backslash must not become the slash
    "end in full width": f"\uff0a\uff0f {LEAK} \uff0f\uff0a",  # letters that decompose into */
    "ends that overlap": f"*/*/ {LEAK} /*/*",
    "newline": f"one\n*/ {LEAK}\n#error two\r\n#error three\u2028#error four\x0b#error five",
    "backslash at the end": "C:\\plants\\",
    "trigraph": "what??/ what???/ what????/",
    "trigraph of letters": "éé/ \u0416\u0416/ ?\u0416/",
    "control characters": "a\0b\x1b[31mc\x7fd\ufeffe\u202ef",
    "braces": "{{ 7 * 7 }} {% for x in y %} {# note #} {{ undefined }}",
    "url": "https://example.org//x/*y",
    "long": "wide " * 40,
    "long word": "w" * 200,
    "long end": "*/" * 100,
    "empty": "",
    "stars": "*",
    "slash": "/",
    "percent and quotes": "%s %n \"' `",
}
# -Wtrigraphs and -Wcomment are of -Wall; C99 replaces trigraphs
CHECK = [*STRICT, "-Wtrigraphs", "-Wcomment", "-Wmissing-prototypes", "-fsyntax-only"]


def hostile_sources(text: str) -> dict[str, str]:
    texts = replace(
        SHAPE.texts,
        title=text,
        statement=(text, "between", text),
        states=(text,) * SHAPE.n,
        inputs=(text,) * SHAPE.m,
    )
    program = SHAPE.program
    shares = tuple(
        replace(s, parameter=Parameter("p", s.parameter.low, s.parameter.high, text, ""))
        for s in program.shares
    )
    return sources(replace(program, shares=shares), texts)


def preprocessed(gcc: str, folder, name: str) -> list[str]:
    """The program without its comments and directives, as the compiler sees it."""
    # -fdirectives-only leaves macros as they are; -P drops the lines' numbers
    ran = run(gcc, "-std=c99", "-E", "-P", "-I", folder, folder / name)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.split()


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    gcc, folder = need("gcc"), tmp_path_factory.mktemp("plain")
    for name, text in hostile_sources("plain").items():
        (folder / name).write_text(text)
    return preprocessed(gcc, folder, "law.c")


@pytest.mark.parametrize("kind", HOSTILE)
def test_nothing_leaks_out_of_comments(tmp_path, plain, kind):
    gcc = need("gcc")
    for name, text in hostile_sources(HOSTILE[kind]).items():
        (tmp_path / name).write_text(text, encoding="ascii")
        assert max(map(len, text.splitlines())) <= 1.3 * WIDTH
    checked = run(gcc, *CHECK, "-I", tmp_path, tmp_path / "law.c")
    assert (checked.returncode, checked.stderr) == (0, "")
    assert preprocessed(gcc, tmp_path, "law.c") == plain


def test_a_leak_would_be_seen(tmp_path, plain):
    for name, text in hostile_sources("MARK").items():
        (tmp_path / name).write_text(text.replace("MARK", f"*/ {LEAK} /*", 1))
    assert preprocessed(need("gcc"), tmp_path, "law.c") != plain


def test_braces_are_text_not_templates():
    header = hostile_sources("{{ 7 * 7 }}")["law.h"]
    assert "x[0]  {{ 7 * 7 }}" in header
    assert "49" not in header


def test_what_people_write_stays_readable():
    assert comment("Kraft à 5 m², Öl") == "Kraft a 5 m2, Ol"
    assert comment("speed [m/s] *2") == "speed [m/s] *2"
    lines = block("word " * 60, "x[0]  ").splitlines()
    assert lines[0].startswith(" *   x[0]  word word")
    assert all(line.startswith(" *         word") for line in lines[1:])
    assert " ".join(lines).count("word") == 60


@given(st.text(st.sampled_from("*/\\? \n\r\t.a\0é\uff0a\uff0f\u2044\u0416"), max_size=40))
def test_comments_stay_comments(text):
    shown = comment(text)
    assert re.fullmatch(r"[ -~]*", shown)
    for bad in ("*/", "/*", "//", "\\", "??"):
        assert bad not in shown
    for line in block(text, "x[0]  ").splitlines():
        assert line.startswith(" *")
        assert "*/" not in line
        assert not line.endswith("\\")


REFUSED = [
    "",
    "1law",
    "_law",
    "law_",
    "two__underscores",
    "a" * 32,
    "a" * 100_000,
    "law-1",
    "law 1",
    "law\n",
    "lаw",  # a Cyrillic letter
    "law/../x",
    "../law",
    "law*/",
    "{{name}}",
    "int",
    "restrict",
    "main",
    "inline",
    "float",
    "string",
    "stdint",
    "Float",
    "math",
    "stdbool",
    "nul",
    "CON",
]


@pytest.mark.parametrize("name", REFUSED, ids=[repr(n[:12]) for n in REFUSED])
def test_names_that_c_cannot_take_are_refused_in_one_line(name):
    with pytest.raises(InputError) as caught:
        check_c_name(name)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 300
    assert message.startswith("name = ")


NAMES = """
A real w p T flags inside within value_at control STATES LIMIT P0 P0_LOW FLT FLT_MAX uint32_t bool
linux class stdint_h
"""
OF_ALPHA = ("real", "onto_simplex", "VERTICES", "a")
TAKEN = [*NAMES.split(), "b" * 31, *OF_ALPHA[1:]]


@pytest.fixture(scope="session")
def taken(tmp_path_factory):
    """What gcc says of laws under each name, the names being compiled in parallel."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("names")
    alpha = BY_LABEL["alpha of four, limits, double"]
    made = {shape: (shape.program, shape.texts) for shape in (SHAPE, alpha)}

    def compiled(name: str) -> subprocess.CompletedProcess[str]:
        program, texts = made[alpha if name in OF_ALPHA else SHAPE]
        folder = root / name
        folder.mkdir()
        for file, text in sources(program, replace(texts, name=name)).items():
            (folder / file).write_text(text)
        return run(gcc, *CHECK, folder / f"{name}.c")

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(TAKEN, pool.map(compiled, TAKEN), strict=True))


@pytest.mark.parametrize("name", TAKEN)
def test_names_that_are_taken_compile(taken, name):
    check_c_name(name)
    assert (taken[name].returncode, taken[name].stderr) == (0, "")


def test_two_laws_live_in_one_program(tmp_path):
    gcc = need("gcc")
    for shape, name in (("fixed, one input", "front"), ("alpha of three", "rear")):
        made = BY_LABEL[shape]
        for file, text in sources(made.program, replace(made.texts, name=name)).items():
            (tmp_path / file).write_text(text)
    (tmp_path / "main.c").write_text(
        '#include "rear.h"\n#include "front.h"\n#include "rear.h"\n'
        "int main(void)\n{\n"
        "    const front_real x[FRONT_STATES] = {0};\n"
        "    const rear_real alpha[REAR_VERTICES] = {1}, y[REAR_STATES] = {0};\n"
        "    front_real u[FRONT_INPUTS];\n    rear_real v[REAR_INPUTS];\n"
        "    return (int)(front_update(x, u) + rear_update(alpha, y, v));\n}\n"
    )
    files = [tmp_path / name for name in ("main.c", "front.c", "rear.c")]
    made = run(gcc, *STRICT, *files, "-o", tmp_path / "main")
    assert (made.returncode, made.stderr) == (0, "")
    assert run(tmp_path / "main").returncode == 0


def test_limits_are_never_rounded_outwards():
    limits = (0.1, 2.0000001)
    text = sources(SHAPE.program, replace(SHAPE.texts, limits=limits))["law.c"]
    found = re.search(r"LIMIT\[INPUTS\] = \{ (.+)F, (.+)F \};", text)
    assert found
    for value, limit in zip(found.groups(), limits, strict=True):
        single = np.float32(value)
        assert float(single) <= limit < float(np.nextafter(single, np.float32(np.inf)))
