"""Console blocks of the documentation: their commands run, what they print beside what is shown."""

import os
import re
import shlex
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from polefence.cli.main import main

COMMAND = re.compile(r"^\$ ((?:.*\\\n)*.*)\n((?:(?!\$ ).*\n)*)", re.MULTILINE)
FAILS = re.compile(r"\A(?:\S+: )?(?:refuted|not \w+)\b|^refuted: ", re.MULTILINE)
SECONDS = re.compile(r"(?<=  proved  ) +\d+\.\d\d$", re.MULTILINE)
NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?:e[+-]?\d+)?(?![\w.])")
GAIN = re.compile(r"^(  [KL](?: at vertex \d+)? =) \[(.*)\]$", re.MULTILINE)


def blocks(page):
    """The console blocks of a page's text."""
    return re.findall(r"```console\n(.*?)```", page, re.DOTALL)


def follow(block, folder, monkeypatch, capsys):
    """Run a block's commands in a folder; each has to print what the block shows behind it."""
    monkeypatch.chdir(folder)
    commands = COMMAND.findall(block)
    assert commands
    for command, shown in commands:
        status, said = answer(command, capsys)
        expected = 2 if shown.startswith("polefence: ") else int(bool(FAILS.search(shown)))
        assert status == expected, (command, said)
        alike(shown, said)


def answer(command, capsys):
    """The exit status of a command and what it prints; ours runs in this process."""
    if not command.startswith("polefence "):
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        done = subprocess.run(
            ["bash", "-c", command], capture_output=True, text=True, env=os.environ | {"PATH": path}
        )
        return done.returncode, done.stdout + done.stderr
    line, _, target = command.replace("\\\n", "").partition(" > ")
    status = main(shlex.split(line)[1:])
    said = capsys.readouterr()
    if target:
        Path(target).write_text(said.out)
    return status, said.err if target else said.out + said.err


def alike(shown, said):
    """Compare the text, and numbers to a unit of the last digit, in which processors may differ.

    Seconds are not compared, gains to 0.1 %; "..." stands for anything.
    """
    gains, printed = dict(GAIN.findall(shown)), dict(GAIN.findall(said))
    for name, numbers in gains.items():
        found = re.split(r"; | ", printed.get(name, ""))
        wanted = np.array(re.split(r"; | ", numbers), float)
        assert np.array(found, float) == pytest.approx(wanted, rel=1e-3), said
    shown, said = (GAIN.sub(r"\1 #", SECONDS.sub("", text)) for text in (shown, said))
    texts = [re.escape(text).replace(re.escape("..."), ".*?") for text in NUMBER.split(shown)]
    found = re.fullmatch(r"(-?\d+\.\d+(?:e[+-]?\d+)?)".join(texts), said, re.DOTALL)
    assert found, said
    for wanted, number in zip(map(Decimal, NUMBER.findall(shown)), found.groups(), strict=True):
        unit = Decimal(1).scaleb(int(wanted.as_tuple().exponent))
        assert abs(Decimal(number) - wanted) <= unit, (number, said)
