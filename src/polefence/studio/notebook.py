"""The page in a notebook: all of it or its panes, each in a cell that one likes."""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass
from html import escape
from http.client import HTTPConnection
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import panel as pn

from polefence.base.errors import InputError, OutputError, suggest
from polefence.certify.checks import in_time_of, require_region
from polefence.certify.design import Design
from polefence.proof.short import Short
from polefence.proof.text import visible
from polefence.region.regions import Region
from polefence.region.text import load_region, parse_region
from polefence.studio.answers import first_region
from polefence.studio.page import Page
from polefence.studio.server import HOST, free_port, listening, shown
from polefence.studio.state import State
from polefence.studio.subject import Subject

HEIGHTS = {"poles": 600, "car": 680, "traces": 800, "service": 260}


@dataclass(frozen=True)
class Frame(Short):
    """What a cell shows of a page.

    Attributes
    ----------
    address : str
    title : str
    height : int
        In pixels.
    width : str
        At most, as CSS has it.
    """

    address: str
    title: str
    height: int
    width: str = "none"

    def _repr_html_(self) -> str:
        style = f"border: 0; width: 100%; max-width: {self.width}; height: {self.height}px"
        where = f'src="{escape(self.address)}" title="{escape(self.title)}" style="{style}"'
        return (
            f'<iframe sandbox="allow-scripts allow-same-origin allow-downloads" {where}></iframe>'
        )


class Notebook:
    """A page whose panes are shown in cells, by a server in this process.

    Parameters
    ----------
    subject : Subject
    state : State
        What it begins with.
    folder : Path
        Where files are saved.
    dark : bool
        Whether it is dark.

    Attributes
    ----------
    page : Page
        The one that all frames show.
    names : tuple of str
        Of its panes.
    address : str
        Of the whole page; whoever has it can use the page.

    Raises
    ------
    OutputError
        If it cannot be served.
    """

    page: Page
    names: tuple[str, ...]

    def __init__(self, subject: Subject, state: State, folder: Path, dark: bool = False) -> None:
        self._given, self._dark = (subject, state, folder), dark
        self._title = visible(subject.plant.name)
        self._token, self._port = secrets.token_urlsafe(24), free_port()
        theme = "dark" if dark else "default"
        # all frames show one session, so that they are in step
        path = f"/{self._token}/?bokeh-session-id=notebook&theme={theme}"
        self.address = f"http://{HOST}:{self._port}{path}"
        ready = SimpleQueue[Any]()
        threading.Thread(
            target=self._serve, args=(ready,), name="polefence notebook", daemon=True
        ).start()
        self._server = ready.get()
        if isinstance(self._server, OutputError):
            raise self._server
        self._begin(path)

    def _serve(self, ready: SimpleQueue[Any]) -> None:
        """Serve in this thread: a cell that is at work does not keep the page waiting."""
        try:
            # the longest there is: a session stays for as long as the notebook does
            server = listening(
                self._shown,
                self._token,
                self._port,
                self._title,
                generate_session_ids=False,
                unused_session_lifetime_milliseconds=2**31 - 1,
            )
        except OutputError as error:
            ready.put(error)
            return
        server.start()
        ready.put(server)
        server.io_loop.start()
        server.io_loop.close(all_fds=True)

    def _begin(self, path: str) -> None:
        """Have the page made before anybody looks at it."""
        connection = HTTPConnection(HOST, self._port)
        try:
            connection.request("GET", path)
            status = connection.getresponse().status
        finally:
            connection.close()
        if status != 200:
            raise OutputError(f"the page cannot be shown: {status}")

    def _shown(self) -> Any:
        document = pn.state.curdoc
        self.page = Page(*self._given, document, self._dark)
        self.names = tuple(self.page.panes())
        return shown(self.page, document, "run the cell again", frames=True)

    def pane(self, name: str, height: int | None = None) -> Frame:
        """Return one pane alone; all that are shown are in step.

        Parameters
        ----------
        name : str
            One of `names`.
        height : int, optional
            In pixels.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        if name not in self.names:
            raise InputError(f"no pane {name!r}; {suggest(name, self.names)}")
        height = HEIGHTS.get(name, 560) if height is None else height
        return Frame(f"{self.address}&pane={name}", f"{self._title}: {name}", height, "760px")

    @property
    def design(self) -> Design | None:
        """The law that is shown now, proved or not; None while there is none."""
        answer = self.page.answer
        return None if answer is None else answer.design

    @property
    def region(self) -> Region:
        """The region that is asked for now."""
        return self.page.history.now.region

    def _repr_html_(self) -> str:
        return Frame(self.address, self._title, 1950)._repr_html_()

    def close(self) -> None:
        """End what is under way, and the server."""
        self.page.close()

        def end() -> None:
            self._server.stop()
            self._server.io_loop.stop()

        self._server.io_loop.add_callback(end)


def notebook(
    path: str | Path,
    region: str | Region | None = None,
    folder: str | Path = "studio",
    dark: bool = False,
) -> Notebook:
    """Open a spec in a notebook.

    Parameters
    ----------
    path : str or Path
        Of a spec.
    region : str or Region, optional
        To begin with; default: that of the file, or an example.
    folder : str or Path
        Where the page saves.
    dark : bool
        Whether the page is dark.

    Returns
    -------
    Notebook
        Shows the whole page as the last line of a cell.

    Raises
    ------
    InputError
        In one line with file, key, value and remedy.
    """
    path = Path(path)
    subject = Subject.read(path)
    if isinstance(region, str):
        region = parse_region(region)
    region = in_time_of(subject.plant, region or load_region(path) or first_region(subject))
    require_region(subject.plant, region)
    return Notebook(subject, State.first(subject, region), Path(folder), dark)
