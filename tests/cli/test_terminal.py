"""Progress and Ctrl-C: what a terminal shows, and how a command ends."""

import os
import pty
import re
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager

import pytest

from polefence import Disk, Parameter, UncertainPlant, place, progress, tightest
from polefence.base.progress import counted, note, stage, told
from polefence.cli.main import main
from polefence.cli.terminal import Line, say, shown_progress
from polefence.lmi.solve import interior_point
from polefence.lmi.solve.engine import kernel

SPEC = """
name = "spring"
[parameter.k]
range = [1, 2]
[matrices]
A = [[0, 1], ["-k", -1]]
B = [[0], [1]]
"""


def spring():
    A, B = [["0", "1"], ["-k", "-1"]], [["0"], ["1"]]
    return UncertainPlant.from_expressions([Parameter("k", 1, 2)], A, B)


# --- what is told --------------------------------------------------------------------------------


def test_stages_are_told_from_the_outermost_on():
    lines = []
    with told(lines.append):
        with stage("outer") as outer:
            note("first")
            with stage("inner"):
                note("half")
            outer.now("renamed")
        note("alone")
    assert lines == [
        "outer",
        "outer, first",
        "outer, first, inner",
        "outer, first, inner, half",
        "outer",
        "renamed",
        "",
        "alone",
    ]


def test_items_are_counted_and_a_loop_that_is_left_leaves_no_stage():
    lines = []
    with told(lines.append):
        for item in counted([5, 6, 7], "start"):
            if item == 6:
                break
        del item
        note("after")
        list(counted(iter([1]), "row"))
    assert lines == ["start 1 of 3", "", "start 2 of 3", "", "after", "row 1", ""]


def test_what_fails_leaves_no_stage():
    lines = []
    with told(lines.append):
        with pytest.raises(ZeroDivisionError), stage("work"):
            1 / 0
        note("next")
    assert lines[-1] == "next"


def test_nobody_is_told_in_another_thread():
    lines = []
    with told(lines.append):
        thread = threading.Thread(target=note, args=("elsewhere",))
        thread.start()
        thread.join()
    assert lines == []


def test_searches_and_proofs_say_how_far_they_are_and_answer_the_same():
    lines = []
    with progress(lines.append):
        followed = tightest(spring(), -3, "quadratic")
    assert followed.region == tightest(spring(), -3, "quadratic").region
    assert any("search, iteration 1" in line for line in lines)
    assert any("proof, inequality 2" in line for line in lines)
    assert lines[-1] == ""


def test_the_reference_counts_its_iterations(monkeypatch):
    monkeypatch.setattr("polefence.lmi.solve.engine._kernel", None)
    lines = []
    with progress(lines.append):
        tightest(spring(), -3, "quadratic")
    seen = [int(found[1]) for line in lines if (found := re.search(r"iteration (\d+)", line))]
    assert max(seen) > 3
    assert all(b in (a, a + 1, 1) for a, b in zip(seen, seen[1:], strict=False))


def test_a_listener_may_end_the_work():
    class Enough(Exception):
        pass

    def listen(words):
        if "proof" in words:
            raise Enough

    with pytest.raises(Enough), progress(listen):
        place(spring(), Disk(-3, 2.9), "quadratic")


# --- the line on a terminal ----------------------------------------------------------------------


class Screen:
    """A terminal with one row that counts: what is written after a return is written over."""

    def __init__(self):
        self.master, slave = pty.openpty()
        self.stream = os.fdopen(slave, "w")
        self.row, self.rows = [], []

    def read(self, until):
        """Read until a row has this; all that is shown now."""
        while until not in "".join(self.row) and until not in "\n".join(self.rows):
            for letter in os.read(self.master, 4096).decode():
                if letter == "\r":
                    self.column = 0
                elif letter == "\n":
                    self.rows.append("".join(self.row).rstrip())
                    self.row, self.column = [], 0
                else:
                    column = getattr(self, "column", 0)
                    self.row[column : column + 1] = [letter]
                    self.column = column + 1
        return "".join(self.row).rstrip()


@pytest.fixture
def screen(monkeypatch):
    found = Screen()
    monkeypatch.setattr(sys, "stderr", found.stream)
    yield found
    found.stream.close()
    os.close(found.master)


def test_the_line_is_rewritten_in_place_and_gone_when_something_is_printed(screen):
    with shown_progress(), stage("a long search, iteration 100"):
        assert screen.read("iteration 100").startswith("a long search")
        say("a result", file=sys.stderr)
        screen.read("a result")
        with stage("proof"):
            assert screen.read("proof").endswith("s)")
    say("the end", file=sys.stderr)
    screen.read("the end")
    assert screen.rows == ["a result", "the end"]


def test_of_a_long_text_the_end_is_shown(screen):
    line = Line(screen.stream)
    line.tell("x" * 300 + " the last words")
    shown = screen.read("the last words (0 s)")
    line.close()
    assert shown.startswith("...x")
    assert len(shown) == 79


def test_nothing_is_shown_where_standard_error_is_no_terminal_or_with_quiet(screen, capsys):
    with shown_progress(wanted=False), stage("hidden"):
        assert threading.active_count() == len(threading.enumerate())
        assert not any(thread.name == "progress" for thread in threading.enumerate())
    with capsys.disabled():
        pass


# --- Ctrl-C --------------------------------------------------------------------------------------

BUSY = """
import os, signal, sys
from polefence.cli import interrupt
interrupt.PATIENCE = 0.1
import numpy as np
with interrupt.cut_off(lambda: os._exit(7)):
    np.linalg.eigvals(np.eye(2))
    os.write(1, b"busy")
    np.linalg.eigvals(np.random.default_rng(0).normal(size=(4000, 4000)))
"""


def test_what_python_cannot_interrupt_is_cut_off():
    process = subprocess.Popen([sys.executable, "-c", BUSY], stdout=subprocess.PIPE)
    assert process.stdout.read(4) == b"busy"
    process.send_signal(signal.SIGINT)
    assert process.wait() == 7


