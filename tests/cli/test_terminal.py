"""Progress and Ctrl-C: what a terminal shows, and how a command ends."""

import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import threading
from itertools import pairwise
from pathlib import Path

import pytest

from polefence import Disk, Parameter, UncertainPlant, place, progress, tightest
from polefence.base.progress import counted, note, stage, told
from polefence.base.workers import processes
from polefence.cli import interrupt, terminal
from polefence.cli.main import main
from polefence.cli.terminal import Line, say, shown_progress
from polefence.search import tradeoff as rows

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
    assert lines == ["start 1 of 3", "", "start 2 of 3", "", "after", "after, row 1", ""]


def test_what_fails_leaves_no_stage():
    lines = []
    with told(lines.append):
        with pytest.raises(ZeroDivisionError), stage("work"):
            raise ZeroDivisionError
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
        assert followed.certificate.prove().proved
    assert followed.region == tightest(spring(), -3, "quadratic").region
    assert any("search, iteration 1" in line for line in lines)
    assert any("proof, inequality 2" in line for line in lines)
    assert lines[-1] == ""


def test_the_reference_counts_its_iterations(monkeypatch):
    monkeypatch.setattr("polefence.base.kernel._kernel", None)
    lines = []
    with progress(lines.append):
        tightest(spring(), -3, "quadratic")
    seen = [int(found[1]) for line in lines if (found := re.search(r"iteration (\d+)", line))]
    assert max(seen) > 3
    assert all(b in (a, a + 1, 1) for a, b in pairwise(seen))


def test_a_listener_may_end_the_work():
    def listen(words):
        if "proof" in words:
            raise TimeoutError

    with pytest.raises(TimeoutError), progress(listen):
        place(spring(), Disk(-3, 2.9), "quadratic")


# --- the line on a terminal ----------------------------------------------------------------------


class Screen:
    """A terminal with one row that counts: what is written after a return is written over."""

    def __init__(self):
        self.master, slave = pty.openpty()
        self.stream = os.fdopen(slave, "w")
        self.row, self.rows = [], []

    def read(self, until):
        """Read until a row has this; return the last row."""
        while until not in "".join(self.row) and until not in "\n".join(self.rows):
            ready, _, _ = select.select([self.master], [], [], 10)
            assert ready, f"{until!r} is not shown, but {self.rows} {''.join(self.row)!r}"
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
def screen(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    Path("spring.toml").write_text(SPEC)
    found = Screen()
    yield found
    found.stream.close()
    os.close(found.master)


def test_the_line_is_rewritten_in_place_and_gone_when_something_is_printed(screen, monkeypatch):
    monkeypatch.setattr(sys, "stderr", screen.stream)
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


def test_there_is_no_line_with_quiet_nor_where_standard_error_is_no_terminal(screen, monkeypatch):
    def lines_of(*words):
        count = len(made)
        assert main(["limits", "spring.toml", "--centre", "-3", *words]) == 0
        return len(made) - count

    made = []
    monkeypatch.setattr(sys, "stderr", screen.stream)
    monkeypatch.setattr(terminal, "Line", lambda stream: made.append(stream) or Line(stream))
    assert lines_of() == 1
    assert lines_of("--quiet") == 0
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert lines_of() == 0


# --- colour --------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    def isatty(self):
        return True


def shown(monkeypatch, stream, *lines, **words):
    monkeypatch.setenv("TERM", "xterm")
    say(*lines, file=stream, **words)
    return stream.getvalue()


def test_a_verdict_is_coloured_once_and_no_other_word(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    lines = "refuted: it was proved, refuted", "proved: no"
    said = shown(monkeypatch, Terminal(), *lines, verdict="refuted")
    assert said == "\x1b[1;31mrefuted\x1b[0m: it was proved, refuted\nproved: no\n"
    assert shown(monkeypatch, Terminal(), "proved: \x1b[1m") == "proved: \\x1b[1m\n"
    assert shown(monkeypatch, Terminal(), "proved: x", verdict="written") == "proved: x\n"


def test_what_is_no_terminal_has_no_colours(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert shown(monkeypatch, io.StringIO(), "proved: x", verdict="proved") == "proved: x\n"
    monkeypatch.setenv("NO_COLOR", "1")
    assert shown(monkeypatch, Terminal(), "proved: x", verdict="proved") == "proved: x\n"
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    stream = Terminal()
    say("proved: x", file=stream, verdict="proved")
    assert stream.getvalue() == "proved: x\n"


# --- long sentences ------------------------------------------------------------------------------

SENTENCE = "  rms of 'travel' <= 2" + ", proved: of all" * 9


def test_a_sentence_is_folded_further_in_on_a_terminal_alone(monkeypatch):
    rows = shown(monkeypatch, Terminal(), SENTENCE).splitlines()
    assert len(rows) > 1
    assert max(map(len, rows)) <= 80
    assert all(row.startswith("      ") and row[6] != " " for row in rows[1:])
    assert " ".join(map(str.strip, rows)) == SENTENCE.strip()
    assert shown(monkeypatch, io.StringIO(), SENTENCE) == f"{SENTENCE}\n"


@pytest.mark.parametrize("text", ["saved: " + "of a folder/" * 9, "x      1.5" * 9, "x" * 200])
def test_paths_and_rows_of_tables_stay_as_they_are(monkeypatch, text):
    assert shown(monkeypatch, Terminal(), text) == f"{text}\n"


# --- Ctrl-C --------------------------------------------------------------------------------------

BUSY = """
import os, signal, threading
from polefence.cli import interrupt
interrupt.PATIENCE = 0.1
import numpy as np
matrix = np.random.default_rng(0).normal(size=(4000, 4000))
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
with interrupt.cut_off(lambda: os._exit(7)):
    np.linalg.eigvals(matrix)  # half a minute, of which Python hears nothing
"""


def test_what_python_cannot_interrupt_is_cut_off():
    assert subprocess.run([sys.executable, "-c", BUSY], check=False).returncode == 7


AT_ONCE = """
import os, signal, sys, threading
from polefence.base.workers import processes
from polefence.cli import interrupt, main

def hold(options):
    with processes(2):
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
        while True:
            pass

if __name__ == "__main__":
    interrupt.PATIENCE = 0.0
    main.COMMANDS = ("hold",)
    main.command = lambda name: (hold, lambda parser: None)
    sys.exit(main.main(["hold"]))
"""


def test_processes_that_are_cut_off_leave_without_a_word(tmp_path):
    script = tmp_path / "at_once.py"
    script.write_text(AT_ONCE)
    run = subprocess.run(
        [sys.executable, str(script)], check=False, capture_output=True, text=True, timeout=60
    )
    assert run.returncode == 130
    assert run.stderr == "polefence: interrupted\n"


def test_what_ends_by_itself_is_not_cut_off(monkeypatch):
    ended = threading.Event()
    monkeypatch.setattr(interrupt, "PATIENCE", 0.05)
    with pytest.raises(KeyboardInterrupt), interrupt.cut_off(ended.set):
        signal.raise_signal(signal.SIGINT)
    assert not ended.wait(0.2)
    assert signal.set_wakeup_fd(-1) == -1


def test_ctrl_c_is_heard_while_workers_start():
    timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        with processes(2):
            pytest.fail("the workers have started")
    timer.join()


def test_an_interrupted_tradeoff_prints_its_finished_rows(screen, monkeypatch, capsys):
    Path("pushed.toml").write_text(SPEC + "E = [[0], [1]]\n")
    words = ["tradeoff", "pushed.toml", "--minimise", "rms of x1 with density 1"]
    words += ["--over", "rms of u1 with density 1", "--method", "quadratic"]
    words += ["--value", "1", "--value", "0.5"]

    def stopping(asked, task):
        if task[0] < 1:
            raise KeyboardInterrupt
        return row_of(asked, task)

    row_of = rows._row_of
    monkeypatch.setattr(rows, "_row_of", stopping)
    assert main(words) == 130
    out, err = capsys.readouterr()
    head, row = out.splitlines()
    assert head.split()[:3] == ["limit", "method", "proved"]
    assert row.split()[:2] == ["1", "quadratic"]
    assert err == "polefence: interrupted\n"


LONG = """
name = "springs"
[parameter]
k0.range = [1, 1.2]
k1.range = [1, 1.2]
k2.range = [1, 1.2]
k3.range = [1, 1.2]
[matrices]
A = [
    [0, 1, 0, 0, 0, 0],
    ["-k0-k1-k2-k3", -1, "k0", 0, 0, 0],
    [0, 0, 0, 1, 0, 0],
    ["k0", 0, "-k0-k1-k2-k3", -1, "k0", 0],
    [0, 0, 0, 0, 0, 1],
    [0, 0, "k0", 0, "-k0-k1-k2-k3", -1],
]
B = [[0], [0], [0], [0], [0], ["k0"]]
"""


def test_an_interrupted_sweep_has_printed_its_finished_rows(screen):
    Path("long.toml").write_text(LONG)
    words = ["limits", "long.toml", "--centre", "-5", "--method", "quadratic"]
    process = subprocess.Popen(
        [sys.executable, "-m", "polefence", *words, "--method", "scheduled"],
        stdout=subprocess.PIPE,
        stderr=screen.stream,
        text=True,
    )
    screen.read("scheduled, search")
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert [line.split()[1] for line in out.splitlines()[2:]] == ["quadratic"]
    screen.read("interrupted")
    assert screen.rows[-1] == "polefence: interrupted"
