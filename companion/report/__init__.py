"""A flight's examination as one HTML file that needs no network, and what such pages are made of."""

from companion.report import markup
from companion.report.charts import Charts
from companion.report.page import bare_html, report_html
from companion.report.section import Section
from companion.report.sheet import sheet
from companion.report.traces import Figure, Panel, Trace, stack

__all__ = ["Charts", "Figure", "Panel", "Section", "Trace", "bare_html", "markup", "report_html", "sheet", "stack"]
