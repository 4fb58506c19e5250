"""A page in the browser in which a region is moved and every car is seen; an extra."""

from polefence.studio.answers import Answer, Newest, first_region, settled
from polefence.studio.folders import Folders
from polefence.studio.notebook import Frame, Notebook, notebook
from polefence.studio.page import Page
from polefence.studio.question import Found, Question
from polefence.studio.server import serve
from polefence.studio.session import SESSION, Session, is_session, put_spec
from polefence.studio.state import History, State
from polefence.studio.subject import Subject

__all__ = [
    "SESSION",
    "Answer",
    "Folders",
    "Found",
    "Frame",
    "History",
    "Newest",
    "Notebook",
    "Page",
    "Question",
    "Session",
    "State",
    "Subject",
    "first_region",
    "is_session",
    "notebook",
    "put_spec",
    "serve",
    "settled",
]
