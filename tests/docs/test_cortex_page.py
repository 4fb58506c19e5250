"""The page of the law on a Cortex-M4F: its numbers, its bits, its errors below what is proved."""

from __future__ import annotations

import re

import numpy as np
import pytest

from polefence.response.discrete import zero_order_hold
from support.cortex import export, missing_tools
from support.gallery import recorded
from support.needed import require
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-cortex.md").read_text()
(SHOWN,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
LEVEL = re.compile(r"  (-O\d): (\d+) instructions, (\d+) bytes")
ROW = re.compile(r"(\d+) kg +(\S+) N +(\S+) N +(\S+) N +(\S+) N")


@pytest.fixture(scope="module")
def example():
    require(missing_tools())
    return docs_script("cortex")


@pytest.fixture(scope="module")
def ran(example, tmp_path_factory):
    return recorded(example, tmp_path_factory.mktemp("page"), ["found"], ["design", "code"])


def test_the_page_has_what_the_script_prints(ran) -> None:
    number = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?")
    words = [re.sub(r"\s+", " ", number.sub("#", text)) for text in (ran.said, SHOWN)]
    assert words[0] == words[1]
    said, shown = (text.split("arm-none-eabi-gcc") for text in (ran.said, SHOWN))
    ours, theirs = (list(map(float, number.findall(own[0]))) for own in (said, shown))
    assert ours == pytest.approx(theirs, rel=1e-2)
    # another compiler makes other code
    same = said[1].split(",")[0] == shown[1].split(",")[0]
    for (level, *costs), (other, *known) in zip(
        *map(LEVEL.findall, (said[1], shown[1])), strict=True
    ):
        assert level == other
        ours, theirs = (list(map(float, own)) for own in (costs, known))
        assert ours == pytest.approx(theirs, rel=0.01 if same else 0.5)
    for ours, theirs in zip(*map(ROW.findall, (ran.said, SHOWN)), strict=True):
        *plain, rounding = map(float, ours)
        *known, other = map(float, theirs)
        assert plain == pytest.approx(known, rel=1e-2)
        assert 0.3 < rounding / other < 3  # of these bits, which another solver may change


def test_bits_are_equal_and_errors_below_the_bound(ran) -> None:
    assert "bits equal on target and host: True" in ran.said
    for u, ideal, error, bound in ran.found.values():
        moving = bound > 0
        assert np.all(error[moving] < bound[moving])
        assert not error[~moving].any()
        share = (error[moving] / bound[moving]).max()
        assert 1e-3 < share < 0.1
        # rounding in float32, not less: half a unit in the last place of u at least
        assert error.max() > 2.0**-26 * np.abs(u).max()
        assert np.abs(u - ideal).max() > 1e4 * error.max()


def test_the_loop_is_that_of_the_law_and_decays_as_is_proved(example, ran) -> None:
    plant, law = ran.design.plant, ran.design.law
    decay = float(re.search(r"proved to decay, at (\S+)\s1/s", PAGE)[1])
    slowest = []
    for load, (u, *_) in ran.found.items():
        K = law.gain_at(m1=load, beta=0)
        _, own = example.driven(plant, load, lambda x, K=K: float(K[0] @ x))
        assert np.abs(u - own).max() < 1e-5 * np.abs(u).max()
        _, other = example.driven(plant, load, lambda x, K=K: float(K[0] @ x) * (1 + 1e-4))
        assert np.abs(u - other).max() > 1e-5 * np.abs(u).max()
        A, B = plant.at(plant.alpha(m1=load, beta=0))
        F, G = zero_order_hold(A, B, example.PERIOD)
        poles = np.linalg.eigvals(np.block([[F, G], [K, np.zeros((1, 1))]]))
        slowest.append(-np.log(np.abs(poles).max()) / example.PERIOD)
    assert decay < min(slowest) < 1.5 * decay


def test_a_wrong_constant_is_noticed(example, ran, tmp_path) -> None:
    ran.code.save(tmp_path)
    random, load = np.random.default_rng(0), max(ran.found)
    x = random.normal(size=(50, 5)) * [0.01, 0.01, 0.3, 0.3, 0.001]
    right = answered(example, tmp_path, "host", load, x)
    assert answered(example, tmp_path, "target", load, x)[0] == right[0]
    error, bound = example.errors(ran.design, ran.code, load, x, right[1])
    assert np.all(error < bound)
    source = tmp_path / "law.c"
    text = source.read_text()
    constants = re.finditer(r"-?\d+\.\d+(?=F)", text)
    largest = max(constants, key=lambda own: abs(float(own[0])))
    changed = f"{1.001 * float(largest[0]):.9g}"
    source.write_text(text[: largest.start()] + changed + text[largest.end() :])
    wrong = answered(example, tmp_path, "host", load, x)
    assert wrong[0] != right[0]
    error, bound = example.errors(ran.design, ran.code, load, x, wrong[1])
    assert np.any(error > bound)


def answered(example, folder, name, load, x):
    with example.Processor(example.built(folder, name)) as processor:
        u = np.array([processor([load, 0, *own]) for own in x])
    return processor.answers, u


def test_instructions_are_those_that_another_means_counts(ran, tmp_path) -> None:
    made = export(ran.design, 32, tmp_path / "law")
    for level, instructions, size in LEVEL.findall(ran.said):
        counts, _ = made.counted(level, 5)
        assert counts.min() - 4 <= int(instructions) <= counts.max() + 4
        assert made.size(level) == int(size)


def test_what_is_missing_is_named(monkeypatch, tmp_path) -> None:
    script = docs_script("cortex")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit) as told:
        script.main(tmp_path)
    for package in ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm"):
        assert package in str(told.value)


def test_a_program_that_ends_is_an_error(example, tmp_path) -> None:
    with pytest.raises(SystemExit, match="ended early"), example.Processor(["true"]) as processor:
        processor([240, 0, 0, 0, 0, 0, 0])


def test_a_flag_is_an_error(example, ran, tmp_path) -> None:
    ran.code.save(tmp_path)
    command = example.built(tmp_path, "target")
    with pytest.raises(SystemExit, match="flags"), example.Processor(command) as processor:
        processor([400, 0, 0, 0, 0, 0, 0])


def test_the_figure_is_drawn(ran) -> None:
    assert ran.image.stat().st_size > 20_000
