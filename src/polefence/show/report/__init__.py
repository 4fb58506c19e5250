"""One self-contained HTML page about a proved design."""

from polefence.show.report.page import html_report

__all__ = ["html_report"]
