"""A flight's examination as one HTML file that needs no network, and what such pages are made of."""

from companion.report import markup
from companion.report.charts import Charts
from companion.report.page import report_html
from companion.report.sheet import sheet
from companion.report.subject import Section
from companion.report.traces import Figure, Panel, Trace, stack

__all__ = ["Charts", "Figure", "Panel", "Section", "Trace", "markup", "report_html", "sheet", "stack"]
