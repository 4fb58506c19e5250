"""Fleets: questions about many variants of a plant, worked out anywhere, kept in one folder."""

from polefence.fleet.checked import Judged, judged
from polefence.fleet.cluster import dask
from polefence.fleet.questions import Answer, Question
from polefence.fleet.run import run
from polefence.fleet.store import Store
from polefence.fleet.study import Study, Task, load_study
from polefence.fleet.variants import Variants
from polefence.fleet.workers import Workers, given, processes

__all__ = [
    "Answer",
    "Judged",
    "Question",
    "Store",
    "Study",
    "Task",
    "Variants",
    "Workers",
    "dask",
    "given",
    "judged",
    "load_study",
    "processes",
    "run",
]
