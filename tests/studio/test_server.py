"""The server: on this machine only, nothing without the token, nothing for other origins."""

import asyncio
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from polefence.examples import spec_text
from support.browser import studio
from support.commands import refused

tornado = pytest.importorskip("tornado.websocket")
pytest.importorskip("panel")


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
    (folder / "secret.txt").write_text("nobody is to read this")
    with studio(folder, "car.toml", "--region", "disk(-40, 31)") as (address, _):
        yield address


@pytest.fixture(scope="module")
def another(tmp_path_factory):
    """The address of a second server, and its process, which the test of Ctrl-C ends."""
    folder = tmp_path_factory.mktemp("another")
    (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
    with studio(folder, "car.toml", "--region", "disk(-40, 31)") as own:
        yield own


DISCRETE = """
sample_time = 0.1
states = ["x"]
inputs = ["u"]
[parameter.a]
range = [0.5, 1.5]
[matrices]
A = [["a"]]
B = [[1]]
"""


def status(address, **headers):
    try:
        request = urllib.request.Request(address, headers=headers)
        with urllib.request.urlopen(request) as answer:
            return answer.status, answer.read().decode(errors="replace")
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(errors="replace")


def root(address):
    own = urlsplit(address)
    return f"{own.scheme}://{own.netloc}", own.path.strip("/")


def test_who_has_the_token_gets_the_page(served):
    code, text = status(served)
    assert code == 200
    assert "quarter car, physical" in text


@pytest.mark.parametrize(
    "path",
    ["/", "", "/static/js/bokeh.min.js", "/ws", "/autoload.js", "/{}x/", "/{}/../", "/metadata"],
)
def test_without_the_token_nothing_is_there(served, path):
    base, token = root(served)
    wrong = token[:-1] + ("a" if token[-1] != "a" else "b")
    code, text = status(base + path.format(wrong))
    assert code in (403, 404)
    assert token not in text
    assert "quarter car" not in text


def test_tokens_are_long_and_new_each_time(served, another):
    assert len(root(served)[1]) >= 32
    assert root(another[0])[1] != root(served)[1]


@pytest.mark.parametrize(
    "path",
    [
        "static/../../secret.txt",
        "static/%2e%2e/%2e%2e/secret.txt",
        "static/..%2f..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
        "static/extensions/panel/..%2f..%2f..%2f..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
        "components/polefence.studio.page/Page/_path/..%2f..%2fpyproject.toml",
        "../secret.txt",
        "secret.txt",
        "studio/session.json",
    ],
)
def test_no_file_is_served(served, path):
    code, text = status(served + path)
    assert code in (400, 403, 404)
    assert "root:" not in text
    assert "nobody" not in text


def opened(address, origin):
    async def connect():
        url = address.replace("http", "ws", 1) + "ws"
        # the token of a session as Bokeh's own client gives it, of the page that was served
        from bokeh.util.token import generate_jwt_token, generate_session_id

        own = generate_jwt_token(generate_session_id())
        request = tornado.httpclient.HTTPRequest(url, headers={"Origin": origin})
        connection = await tornado.websocket_connect(request, subprotocols=["bokeh", own])
        try:
            return await connection.read_message()
        finally:
            connection.close()
            while await connection.read_message() is not None:
                pass

    return asyncio.run(connect())


def test_a_websocket_of_another_origin_is_refused(served):
    base, _ = root(served)
    assert "ACK" in opened(served, base)
    for origin in ("http://example.org", "http://localhost:1", "null", "https://localhost.example"):
        with pytest.raises(tornado.httpclient.HTTPClientError) as caught:
            opened(served, origin)
        assert caught.value.code == 403


def test_a_websocket_without_the_token_is_refused(served):
    base, _ = root(served)
    with pytest.raises(tornado.httpclient.HTTPClientError) as caught:
        opened(base + "/", base)
    assert caught.value.code == 404


def table(name):
    return Path("/proc/net", name).read_text().splitlines()


@pytest.mark.skipif(not Path("/proc/net/tcp").is_file(), reason="needs /proc")
def test_only_this_machine_is_listened_to(served):
    port = f"{urlsplit(served).port:04X}"
    lines = [line.split() for own in ("tcp", "tcp6") for line in table(own)]
    ours = {line[1] for line in lines if line[1].endswith(f":{port}") and line[3] == "0A"}
    assert ours == {f"0100007F:{port}"}


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_it(another):
    _, process = another
    process.send_signal(signal.SIGINT)
    said = process.stdout.read()
    assert process.wait(20) == 0
    assert said == "whoever has this address can use it; Ctrl-C ends it\n"


def test_a_port_that_is_taken_is_named(tmp_path):
    (tmp_path / "car.toml").write_text(spec_text("quarter-car-physical"))
    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        own.listen()
        port = own.getsockname()[1]
        words = [sys.executable, "-m", "polefence", "studio", "car.toml", "--no-browser"]
        words += ["--region", "disk(-40, 31)", "--port", str(port)]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert re.fullmatch(rf"polefence: --port {port}: cannot be served there: .*\n", done.stderr)


def test_bad_input_is_one_line_before_anything_is_served(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.toml").write_text(spec_text("quarter-car-physical"))
    Path("bad.toml").write_text("name = 3")
    assert "--port = 70000" in refused(capsys, "studio", "car.toml", "--port", "70000")
    assert "bad.toml" in refused(capsys, "studio", "bad.toml")
    assert "none.toml" in refused(capsys, "studio", "none.toml")
    assert "circle" in refused(capsys, "studio", "car.toml", "--region", "circle(1)")
    words = ["studio", "discrete.toml", "--region", "disk(3, 2)"]
    Path("discrete.toml").write_text(DISCRETE)
    assert "disk(3, 2)" in refused(capsys, *words)
    assert not Path("studio").exists()
