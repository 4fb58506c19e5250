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
from polefence.studio.folders import Folders
from polefence.studio.page import COLUMNS, Page
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
    opened: Path | None = None,
) -> None:
    """Serve a session until Ctrl-C.

    Parameters
    ----------
    subject : Subject
    state : State
        What a page begins with.
    folder : Path
        Where files are saved: the first page there, each other one in a folder beside it.
    port : int
        0: one that is free.
    show : bool
        Whether to open a browser.
    ready : callable
        Called with the address.
    opened : Path, optional
        The session that is gone on with, where it lies in the folder.

    Raises
    ------
    OutputError
        If the port is taken.
    """
    token, pages = secrets.token_urlsafe(24), WeakSet[Page]()
    folders = Folders(folder, opened)

    def page() -> Any:
        document = pn.state.curdoc
        view = Page(subject, state, folders, document, pn.config.theme == "dark")
        pages.add(view)
        pn.state.on_session_destroyed(lambda _: view.close())
        return shown(view, document, "start it again, and open the address that it prints")

    pn.extension()
    port = port or free_port()
    with small_matrices():
        server = listening(page, token, port, visible(subject.plant.name))
        address = f"http://{HOST}:{port}/{token}/"
        ready(address)
        if show:
            webbrowser.open(address)
        server.start()
        try:
            server.io_loop.start()
        finally:
            for view in pages:
                view.close()


class Whole(pn.Template):  # type: ignore[misc]
    """A template whose panes come into a document together.

    Bokeh looks through all of a document whenever something comes into it, which would be a third
    of what a page costs to make.
    """

    def server_doc(self, doc: Any = None, *given: Any, **more: Any) -> Any:
        """Return the document with the panes in it."""
        with doc.models.freeze():
            return super().server_doc(doc, *given, **more)

    def __repr__(self) -> str:
        """Return no more than a name: Panel asks for it at each pane, and shows it nowhere here."""
        return type(self).__name__


def shown(page: Page, document: Any, remedy: str, frames: bool = False) -> Any:
    """Return what a document shows of a page, each pane laid out by itself.

    Parameters
    ----------
    remedy : str
        What to do once the server has ended.
    frames : bool
        Whether it is looked at in several frames, each of one pane.
    """
    code = template("ended.js")
    document.js_on_event(ConnectionLost, CustomJS(args={"remedy": remedy}, code=code))
    made, panes = Whole(template("page.html")), page.panes()
    variables = {"heading": visible(page.plant.name), "frames": frames}
    variables |= {"columns": COLUMNS, "shown": tuple(panes)}
    for name, value in (variables | {"app_favicon": "data:,", "apple_icon": "data:,"}).items():
        made.add_variable(name, value)
    for name, pane in panes.items():
        made.add_panel(f"{name}_pane", pane)
    return made


def listening(page: Callable[[], Any], token: str, port: int, title: str, **more: Any) -> Any:
    """Return a server of a page, on this machine alone, behind a token.

    Raises
    ------
    OutputError
        If the port is taken.
    """
    try:
        return pn.io.server.get_server(
            {"/": page},
            port=port,
            address=HOST,
            prefix=token,
            websocket_origin=[f"{HOST}:{port}"],
            title=title,
            location=False,
            start=False,
            show=False,
            **more,
        )
    except OSError as error:
        raise OutputError(f"--port {port}: cannot be served there: {error.strerror}") from error


def free_port() -> int:
    """Return a port that is free."""
    with socket.socket() as listener:
        listener.bind((HOST, 0))
        port: int = listener.getsockname()[1]
        return port
