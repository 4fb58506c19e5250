"""Studies on Dask clusters: the same rows, whatever dies."""

import os
import signal
import socket
import subprocess
import sys
from collections import Counter
from contextlib import contextmanager

import pytest

from polefence.base.errors import MissingExtraError
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.fleet import Store, dask, load_study, run
from polefence.fleet.questions import Tightest
from support.commands import refused
from support.studies import keys

distributed = pytest.importorskip("distributed")
pytest.importorskip("pyarrow")

STUDY = """
base = "car.toml"
[variants]
random = {count = COUNT, of = {m2 = [25, 32]}}
[[question]]
ask = "tightest"
centre = -40
[[question]]
name = "decay"
ask = "tightest"
of = "half_plane"
"""


def write(folder, count):
    (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
    path = folder / "study.toml"
    path.write_text(STUDY.replace("COUNT", str(count)))
    return path


def every(count):
    return Counter((k, name) for k in range(count) for name in ("tightest", "decay"))


@contextmanager
def scheduler(port):
    """A scheduler and two workers, as processes; all of them are killed at the end."""
    options = ["--no-dashboard"]
    words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(port), *options]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    own = [subprocess.Popen(words, **quiet)]
    words = [sys.executable, "-m", "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}"]
    words += ["--nworkers", "2", "--nthreads", "1", *options]
    own.append(subprocess.Popen(words, **quiet))
    try:
        yield f"tcp://127.0.0.1:{port}"
    finally:
        for process in own:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def port():
    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        return own.getsockname()[1]


@pytest.fixture
def small_groups(monkeypatch):
    """Have as many tasks as four times the variants would make by default."""
    monkeypatch.setattr(Tightest, "group", 4)


def test_rows_are_those_of_processes(tmp_path, monkeypatch):
    path = write(tmp_path, 5)
    monkeypatch.setattr("polefence.fleet.cluster.processors", lambda: 1)
    assert main(["study", str(path), "-o", str(tmp_path / "a"), "--cluster", "local"]) == 0
    assert main(["study", str(path), "-o", str(tmp_path / "b"), "--jobs", "1"]) == 0
    found = []
    for name in "ab":
        rows = sorted(Store(tmp_path / name).rows(), key=lambda r: (r["variant"], r["question"]))
        found.append([{k: row[k] for k in row if k not in ("seconds", "digest")} for row in rows])
    assert found[0] == found[1]
    assert keys(tmp_path / "a") == every(5)


@pytest.mark.skipif(sys.platform == "win32", reason="kills by POSIX signals")
def test_workers_that_are_killed_lose_no_row(tmp_path, port, small_groups, capsys):
    study, out = load_study(write(tmp_path, 12)), tmp_path / "out"
    with scheduler(port) as address:
        workers = dask(address)
        for k, _ in enumerate(run(study, Store(out), workers)):
            if k in (1, 4):
                with distributed.Client(address, set_as_default=False) as client:
                    pids = list(client.run(os.getpid).values())
                os.kill(pids[0], signal.SIGKILL)
        assert keys(out) == every(12)
        assert main(["study", str(out), "--check", "--cluster", address]) == 0
    assert "24 rows, 24 with proofs; 0 faults" in capsys.readouterr().out


@pytest.mark.skipif(sys.platform == "win32", reason="kills by POSIX signals")
def test_a_scheduler_that_is_started_again_is_found(tmp_path, port, small_groups):
    study, out = load_study(write(tmp_path, 12)), tmp_path / "out"
    with scheduler(port) as address:
        rows = run(study, Store(out), dask(address))
        next(rows)
    before = sum(keys(out).values())
    with scheduler(port):
        fresh = sum(len(own) for own in rows)
    assert 0 < before < 24
    assert before + fresh == 24
    assert keys(out) == every(12)


def test_no_scheduler_is_one_line(tmp_path, capsys, monkeypatch, port):
    path = write(tmp_path, 2)
    words = ["study", str(path), "-o", str(tmp_path / "out"), "--cluster"]
    monkeypatch.setattr("polefence.fleet.cluster.PATIENCE", 1)
    message = refused(capsys, *words, f"tcp://127.0.0.1:{port}")
    assert f"--cluster tcp://127.0.0.1:{port}: no scheduler there: " in message
    assert "--jobs is for processes" in refused(capsys, *words, "local", "--jobs", "2")
    assert not (tmp_path / "out").exists()
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match="pip install 'polefence\\[cluster\\]'"):
        dask()
