"""The figure of a trade-off. Data in, Figure out; touches no file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from polefence.design.signals.tradeoff_front import Front
from polefence.show.plots.plots import new_figure, styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLED: dict[str, Any] = {"ls": "none", "marker": ".", "ms": 4, "zorder": 3}
SAMPLED_LABEL = "the same laws, worst of a sample"
REFERENCE: dict[str, Any] = {"ls": "none", "marker": "*", "ms": 9, "color": "black", "mfc": "white"}


def front_figure(front: Front) -> Figure:
    """Draw the least bound on one signal over the bound on another, a line a method.

    Marks are laws: what is proved of each, in both signals. A law that does not use up its limit
    is drawn at what it keeps; the line goes on, level, to the largest limit that was asked for.
    Lines between marks are for the eye. Dots are where the same laws come out at sampled
    parameters, stars are reference laws there, in brackets where one exceeds another limit: about
    those nothing is proved.

    Parameters
    ----------
    front : Front
    """
    figure, (ax,) = new_figure(1, 6.4, 4.2)
    known = styles(front.methods)
    for k, method in enumerate(front.methods):
        rows = [r for r in front.rows if r["method"] == method and r["status"] == "proved"]
        pairs = sorted({(r["bounds"][0]["proved"], r["proved"]) for r in rows})
        line = [*pairs, (max(r["value"] for r in rows), pairs[-1][1])] if pairs else []
        style: dict[str, Any] = {"marker": "os^D"[k % 4]} | known[method]
        style |= {"ms": 6.5, "mfc": "none", "markevery": list(range(len(pairs)))}
        style["label"] = f"{style['label'].partition(' (Lemma')[0]}, proved"
        ax.plot([x for x, _ in line], [y for _, y in line], **style)
        dots = {(r["bounds"][0]["sampled"], r["sampled"]) for r in rows}
        seen = sorted(pair for pair in dots if None not in pair)
        x, y = [x for x, _ in seen], [y for _, y in seen]
        ax.plot(x, y, color=known[method]["color"], **SAMPLED)
    ax.plot([], [], color="0.3", label=SAMPLED_LABEL, **SAMPLED)
    for k, row in enumerate(front.references):
        ax.plot(row["over"], row["minimise"], **REFERENCE)
        place: dict[str, Any] = (
            {"xytext": (7, 4)} if k < 2 else {"xytext": (-7, -11), "ha": "right"}
        )
        at = (row["over"], row["minimise"])
        ax.annotate(row["name"], at, textcoords="offset points", fontsize=8.5, **place)
    ax.margins(0.06, 0.1)
    ax.set_xlabel(f"worst {front.labels[0]}")
    ax.set_ylabel(f"worst {front.labels[1]}")
    ax.legend(loc="best", fontsize=8.5)
    return figure
