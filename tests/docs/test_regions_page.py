"""docs/regions.md: its commands do what it shows, its example states what is measured."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from polefence import check, load, place
from polefence.examples import spec_path
from polefence.region.text import load_region
from polefence.show.plots import sampled
from support.console import blocks, follow
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "regions.md").read_text()


@pytest.fixture(scope="module")
def example():
    return docs_script("regions")


@pytest.mark.parametrize("block", blocks(PAGE))
def test_the_commands_print_what_the_page_shows(block, tmp_path, monkeypatch, capsys):
    shutil.copy(spec_path("f16"), tmp_path)  # that of the page's first command
    (cart,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "cart.toml").write_text(cart)
    follow(block, tmp_path, monkeypatch, capsys)


def row(start):
    """The numbers of the table's row that starts so."""
    (line,) = [line for line in PAGE.splitlines() if line.startswith(f"| {start} |")]
    return line.strip("| ").split(" | ")[1:]


def test_the_smallest_disks_are_those_of_the_table(example):
    for degree, elevation, *radii in example.disks():
        start = f"({degree}, {elevation})" if degree else "one gain"
        assert row(start) == [f"{float(radius):.4f}" for radius in radii]


def test_the_example_states_what_is_measured(example):
    plant = load(example.SPEC)
    assert load_region(example.SPEC) == example.pf.HalfPlane(6) & example.SPEED
    unstable = np.linalg.eigvals(plant.A).real.max(axis=1) > 0
    assert unstable.sum() == 2
    assert "At two of its four vertices the open loop is unstable" in PAGE
    rates = []
    for method in example.METHODS:
        design = example.fastest(plant, method)
        assert check(design).proved
        label = design.label
        decay, gain = row(f"one gain, `{label}`" if label == "quadratic" else f"`{label}`")
        assert decay == example.decay(design)
        largest = np.abs(design.law.gain(np.eye(4))[..., 0, 0]).max()
        assert largest == pytest.approx(float(gain), rel=0.05)
        rates.append(float(decay))
        if label == "quadratic":
            slowest = sampled(design)[0].real.max()
            assert f"slowest pole is at −{-slowest:.2f} 1/s" in PAGE
            assert 1 < -slowest / design.region.parts[0].decay < 1.01
    assert rates == sorted(rates)


def test_the_published_numbers_are_in_the_family():
    """At the condition of the textbook the family gives the textbook's matrices."""
    plant = load(spec_path("f16"))
    A, B = plant.at(plant.alpha(Q="14.364", V=153))
    published = [[-1.01887, 0.90506, -0.00215], [0.82225, -1.07741, -0.17555], [0, 0, -20.2]]
    assert np.abs(A - published).max() < 1e-12
    assert B.ravel().tolist() == pytest.approx([0, 0, 20.2])


def test_the_figure_is_made(example, tmp_path, monkeypatch):
    plant, region = load(example.SPEC), load_region(example.SPEC)
    designs = {m: place(plant, region, m) for m in ("scheduled",)}
    monkeypatch.setattr(example, "disks", list)
    example.main(tmp_path)
    assert (tmp_path / "regions.png").read_bytes().startswith(b"\x89PNG")
    cloud, _ = sampled(designs["scheduled"])
    assert len(cloud) >= 2000
    assert region.contains(cloud)
