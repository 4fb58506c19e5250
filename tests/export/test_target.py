"""The C code on this machine and on an emulated Cortex-M4F: what it answers and what it costs."""

import numpy as np
import pytest

from polefence.export.vectors import ALLOWED
from support.cortex import CORTEX, emulated, run
from support.cycles import most

COUNT = {32: 100_000, 64: 20_000}  # the target has doubles in software alone
# Of the main case: quarter car, Theorem 1, five states, four vertices, float32.
INSTRUCTIONS = {"-O2": 1900, "-O3": 1000}
BYTES = 4096


@pytest.mark.parametrize("given", ["parameters", "alpha"])
@pytest.mark.parametrize("bits", [32, 64])
def test_code_equals_the_law_on_host_and_target(emulator, exported, bits, given):
    made = exported("scheduled", bits, given)
    count = COUNT[bits]
    host = made.answers(made.host("many.c", f"-DCOUNT={count}U"), count, "host")
    target = made.answers(made.target("many.c", f"-DCOUNT={count}U"), count, "target")
    assert host.dtype == made.real
    assert host.tobytes() == target.tobytes()
    error, plain = made.errors(host)
    assert 0 < error < ALLOWED[bits]
    # law.gain in doubles is off by rounding itself, by as much as 1e-12
    assert abs(plain - error) < 1e-11
    # and what is compared can differ
    assert made.errors(host[:100] * (1 + 2 * ALLOWED[bits]))[0] > ALLOWED[bits]


@pytest.mark.parametrize("kind", ["degree 2", "fixed"])
def test_other_laws_on_host_and_target(emulator, exported, kind):
    made, count = exported(kind, 32), COUNT[32] // 10
    host = made.answers(made.host("many.c", f"-DCOUNT={count}U", level="-O3"), count, "host")
    target = made.answers(made.target("many.c", f"-DCOUNT={count}U"), count, "target")
    assert host.tobytes() == target.tobytes()
    assert max(made.errors(host)) < ALLOWED[32]


@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize("given", ["parameters", "alpha"])
def test_the_exported_test_passes_on_the_target(emulator, exported, bits, given):
    made = exported("scheduled", bits, given)
    lines = run(*emulated(made.target("law_test.c"))).splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2


def test_a_failed_test_is_a_failure_of_the_emulator(emulator, exported, tmp_path):
    made = exported("scheduled", 32)
    text = (made.folder / "law_test.c").read_text()
    (made.folder / "wrong.c").write_text(text.replace("error > 1.0", "error > 1.0e-3"))
    assert "FAILED" in run(*emulated(made.target("wrong.c")), status=1)


@pytest.mark.parametrize("level", ["-O2", "-O3"])
def test_cost_of_the_main_case(emulator, exported, level):
    made = exported("scheduled", 32)
    counts, stack = made.counted(level)
    assert counts.max() <= INSTRUCTIONS[level]
    # inputs change nothing but which way a clamp goes
    assert np.ptp(counts) <= 8
    # another means, for the first input: the list of what was executed
    assert made.traced(level) == counts[0]
    cycles = made.cycles(level)
    assert counts.max() < cycles < 4 * counts.max()
    assert made.size(level) < BYTES
    assert stack <= made.stack(level) < 256


def test_the_makefile_says_the_sizes(emulator, exported):
    made = exported("scheduled", 32)
    run(
        "make", "test", cwd=made.folder
    )  # for this machine: nothing of it may be taken for the other
    words = ["CC=arm-none-eabi-gcc", "SIZE=arm-none-eabi-size", f"CFLAGS=-O3 {' '.join(CORTEX)}"]
    said = run("make", "-s", "size", *words, cwd=made.folder)
    assert f"\n{made.size('-O3'):7d}\t" in said
    assert f"law_update\t{made.stack('-O3')}\tstatic" in said


def test_cycles_are_those_that_are_published():
    cases = {
        ("vadd.f32", "s15, s15, s14"): 2,
        ("vdiv.f32", "s1, s2, s3"): 15,
        ("vmla.f32", "s1, s2, s3"): 4,
        ("vldr", "s14, [r2, #4]"): 2,
        ("vldr", "d8, [r2, #8]"): 3,
        ("vpush", "{d8-d10}"): 7,
        ("push", "{r4, r5, r6, lr}"): 5,
        ("pop", "{r4, r5, r6, pc}"): 8,
        ("ldmia.w", "sp!, {r4-r9, pc}"): 11,
        ("ldr.w", "r3, [r0, r1, lsl #2]"): 2,
        ("bne.n", "12c <law_update+0x40>"): 4,
        ("movgt", "r3, #1"): 1,
        ("ite", "lt"): 1,
        ("vmrs", "APSR_nzcv, fpscr"): 1,
        ("udiv", "r1, r2, r3"): 12,
    }
    for (name, operands), cycles in cases.items():
        assert most(name, operands) == cycles, name
    with pytest.raises(KeyError):  # no instruction is taken for free
        most("wfi", "")
