"""``polefence study``: questions about many variants of a plant, kept in one folder."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, suggest
from polefence.base.files import check_target, write_text
from polefence.base.progress import stage
from polefence.cli.options import jobs_of, sweep_arguments
from polefence.cli.output import NOT_PROVED, PROVED, saved
from polefence.cli.terminal import say
from polefence.fleet.checked import judged
from polefence.fleet.cluster import dask
from polefence.fleet.questions import GOOD, Question, read_questions
from polefence.fleet.questions import PROVED as ROW_PROVED
from polefence.fleet.run import run, worked_out
from polefence.fleet.store import Row, Store, alike, value_of
from polefence.fleet.study import Study, load_study
from polefence.fleet.workers import Workers, here, processes
from polefence.plant.spec import loads
from polefence.proof.text import plural
from polefence.region.text import digits_down, digits_up

BEST = 10  # rows of --best


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `study`."""
    parser.add_argument(
        "study", metavar="STUDY", type=Path, help="a TOML file, or a folder of results"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="RESULTS", help="a folder for results")
    sweep_arguments(parser, "go on with what RESULTS has")
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="of a Dask scheduler, tcp://host:8786; local: one is started here",
    )
    parser.add_argument(
        "--estimate",
        action="store_true",
        help="try one group of each question; say what all would take",
    )
    parser.add_argument(
        "--variant", type=int, metavar="N", help="print the spec of one variant, counted from 0"
    )
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page about results")
    parser.add_argument("--check", action="store_true", help="prove every row of results afresh")
    parser.add_argument(
        "--best", metavar="QUESTION", help=f"of results the {BEST} best rows of a question"
    )


def study_command(options: Any) -> int:
    """Ask questions about many variants of a plant; keep every row with its proof."""
    jobs_of(options)
    if options.study.is_dir():
        return _of_results(Store(options.study), options)
    for key in ("check", "best", "html"):
        if getattr(options, key):
            raise InputError(f"--{key} is for a folder of results; name that")
    study = load_study(options.study)
    if options.variant is not None:
        return _variant(study, options.variant)
    if options.estimate:
        return _estimated(study)
    if options.output is None:
        raise InputError("-o RESULTS is missing: the folder for results")
    return _worked_out(study, Store(options.output), options)


def _estimated(study: Study) -> int:
    """Work out one group of each question, and say what all of them would take."""
    say(f"{study.name}: {len(study.variants)} variants of {', '.join(study.variants.names)}")
    seconds, size, count = 0.0, 0.0, len(study.variants)
    for question in study.questions:
        few, begin = study.tried(question), time.perf_counter()
        answers = [answer for _, group in worked_out(few, here()) for answer in group.values()]
        lasted = (time.perf_counter() - begin) / len(answers)
        seconds += count * lasted
        size += count * sum(len(answer.document or "") for answer in answers) / len(answers)
        say(f"  {question.name}: {question.words}: {lasted:.2g} s a variant")
    took = f"about {_lasting(seconds)} of one processor, {size / 1e6:.2g} MB"
    say(f"  {study.total} rows: {took}")
    return PROVED


def _worked_out(study: Study, store: Store, options: Any) -> int:
    fresh, begin = 0, time.perf_counter()
    there = len(store.done()) if options.resume else 0
    with stage(f"{there} of {study.total} rows") as progress:
        for rows in run(study, store, _workers(options), options.resume):
            fresh += len(rows)
            done, rate = there + fresh, fresh / (time.perf_counter() - begin)
            left = _lasting((study.total - done) / rate)
            progress.now(f"{done} of {study.total} rows, {rate:.3g} a second, {left} left")
    say(f"{store.folder}: {study.total} rows, {fresh} of them new")
    return _said(list(store.rows()), study.questions, study.total)


def _lasting(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _workers(options: Any) -> Workers:
    if options.cluster is None:
        return processes(options.jobs)
    if options.jobs is not None:
        raise InputError("--jobs is for processes; a cluster has its own workers")
    try:
        return dask(options.cluster)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {options.cluster}: no scheduler there: {error}") from error


def _variant(study: Study, number: int) -> int:
    count = len(study.variants)
    if not 0 <= number < count:
        raise InputError(f"--variant = {number}: there are 0 to {count - 1}")
    say(*study.spec(number).splitlines())
    return PROVED


def _of_results(store: Store, options: Any) -> int:
    """Say how far results are; prove them afresh, or show the best, where that is asked."""
    for key in ("output", "resume", "estimate", "variant"):
        if getattr(options, key) not in (None, False):
            raise InputError(f"--{key} is for a study, and {store.folder} is a folder of results")
    about = store.about
    questions = read_questions(about["questions"])
    names = [q.name for q in questions]
    data = loads(about["base"]).data  # which says beside all answers what is not proved
    if options.check:
        return _checked(store, options)
    if options.html is not None:
        check_target(options.html)
    rows = list(store.rows())
    if options.best is not None:
        if options.best not in names:
            raise InputError(f"--best {options.best!r}: {suggest(options.best, names)}")
        question = questions[names.index(options.best)]
        return _best([row for row in rows if row["question"] == question.name], question, about)
    if options.html is not None:
        from polefence.show.fleet import fleet_page

        pairs = [(q.name, q.largest) for q in questions]
        failed = alike([row for row in rows if row["status"] not in GOOD])
        valued = [row | {"value": value_of(row)} for row in rows]
        note = "" if data is None else data.note
        text = fleet_page(about["name"], about["names"], pairs, valued, failed, note)
        write_text(options.html, text)
        saved(options.html)
    total = len(about["rows"]) * len(names)
    say(f"{store.folder}: {len(rows)} of {total} rows of {about['name']}")
    return _said(rows, questions, total)


def _checked(store: Store, options: Any) -> int:
    every, faults = 0, 0
    with stage("0 rows proved afresh") as progress:
        for judgement in judged(store, _workers(options)):
            every += 1
            progress.now(f"{every} rows proved afresh")
            if judgement.fault:
                faults += 1
                say(f"variant {judgement.variant}, {judgement.question}: {judgement.fault}")
    proofs = sum(1 for row in store.rows() if row["proof"])
    say(f"{store.folder}: {every} rows, {proofs} with proofs; {faults} faults")
    return NOT_PROVED if faults else PROVED


def _best(rows: Sequence[Row], question: Question, about: Mapping[str, Any]) -> int:
    """Print the rows with the best bounds."""
    valued, names = [(value_of(row), row) for row in rows], about["names"]
    known = [(value, row) for value, row in valued if value is not None]
    if not known:
        raise InputError(f"no row of {question.name} has a bound")
    sign = -1 if question.largest else 1
    known.sort(key=lambda pair: (sign * pair[0], pair[1]["variant"]))
    digits, head = _weaker(question), [f"{name:>12}" for name in names]
    title = "bound" if known[0][1]["bound"] is not None else "sample"
    say(f"{'variant':>8}  {title:>10}  {'unit':<6}{''.join(head)}  label".rstrip())
    for value, row in known[:BEST]:
        values = "".join(
            f"{'-' if row[name] is None else f'{row[name]:.6g}':>12}" for name in names
        )
        line = f"{row['variant']:>8}  {digits(value):>10}  {row['unit']:<6}{values}"
        say(f"{line}  {row['label']}".rstrip())
    return PROVED


def _weaker(question: Question) -> Callable[[float], str]:
    """Return how bounds are rounded."""
    return digits_down if question.largest else digits_up


def _said(rows: Sequence[Row], questions: Sequence[Question], total: int) -> int:
    """Say what rows are; return 1 where one is not proved, or missing."""
    for question in questions:
        answers = [row for row in rows if row["question"] == question.name]
        counts = Counter(row["status"] for row in answers)
        said = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
        values = [value for row in answers if (value := value_of(row)) is not None]
        if question.together and counts[ROW_PROVED]:
            laws = Counter(row["law"] for row in answers if row["law"])
            sizes = ", ".join(str(count) for _, count in laws.most_common())
            said += f"; by {plural(len(laws), 'law')}: of {sizes} variants"
        if values:
            digits, unit = (
                _weaker(question),
                next((row["unit"] for row in answers if row["unit"]), ""),
            )
            span = f"{digits(min(values))} to {digits(max(values))} {unit}"
            said += f"; {span.rstrip()}"
        say(f"  {question.name}: {said or 'nothing yet'}")
    bad = [row for row in rows if row["status"] not in GOOD]
    for row, count in alike(bad)[:5]:
        variants = f"variant {row['variant']}" + f" and {count - 1} more" * (count > 1)
        say(f"  {row['question']}, {variants}: {row['status']}: {row['reason']}")
    return NOT_PROVED if bad or len(rows) < total else PROVED
