"""A page in the browser in which a region is moved and every car is seen; an extra."""

from polefence.studio.answers import Answer, Newest, first_region
from polefence.studio.page import Page
from polefence.studio.server import serve
from polefence.studio.state import PLANT, History, Session, State, is_session, read_session

__all__ = [
    "PLANT",
    "Answer",
    "History",
    "Newest",
    "Page",
    "Session",
    "State",
    "first_region",
    "is_session",
    "read_session",
    "serve",
]
