"""The studio's server: on this machine only, behind a token in its address."""

from __future__ import annotations

import secrets
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakSet

import panel as pn
from bokeh.events import ConnectionLost
from bokeh.models import CustomJS

from polefence.base.errors import OutputError
from polefence.base.processors import small_matrices
from polefence.proof.text import visible
from polefence.studio.page import Page
from polefence.studio.state import State
from polefence.studio.subject import Subject
from polefence.studio.templates import template

HOST = "127.0.0.1"


def serve(
    subject: Subject,
    state: State,
    folder: Path,
    port: int = 0,
    show: bool = True,
    ready: Callable[[str], object] = print,
) -> None:
    """Serve a session until Ctrl-C.

    Parameters
    ----------
    subject : Subject
    state : State
        What a page begins with.
    folder : Path
        Where files are saved.
    port : int
        0: one that is free.
    show : bool
        Whether to open a browser.
    ready : callable
        Called with the address.

    Raises
    ------
    OutputError
        If the port is taken.
    """
    token, pages = secrets.token_urlsafe(24), WeakSet[Page]()

    def page() -> Any:
        document = pn.state.curdoc
        dark = pn.config.theme == "dark"
        own = Page(subject, state, folder, document, dark)
        pages.add(own)
        pn.state.on_session_destroyed(lambda _: own.close())
        document.js_on_event(ConnectionLost, CustomJS(code=template("ended.js")))
        shown = pn.Template(template("page.html"))
        shown.add_variable("heading", visible(subject.plant.name))
        shown.add_variable("app_favicon", "data:,")
        shown.add_variable("apple_icon", "data:,")
        shown.add_panel("body", own.view())
        return shown

    pn.extension()
    port = port or _free()
    with small_matrices():
        try:
            server = pn.io.server.get_server(
                {"/": page},
                port=port,
                address=HOST,
                prefix=token,
                websocket_origin=[f"{HOST}:{port}"],
                title=visible(subject.plant.name),
                location=False,
                start=False,
                show=False,
            )
        except OSError as error:
            raise OutputError(f"--port {port}: cannot be served there: {error.strerror}") from error
        address = f"http://{HOST}:{port}/{token}/"
        ready(address)
        if show:
            webbrowser.open(address)
        server.start()
        try:
            server.io_loop.start()
        finally:
            for own in pages:
                own.close()


def _free() -> int:
    """Return a port that is free."""
    with socket.socket() as own:
        own.bind((HOST, 0))
        port: int = own.getsockname()[1]
        return port
