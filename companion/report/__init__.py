"""A flight's examination as one HTML file that needs no network: to mail, to print, to keep."""

from companion.report.page import report_html

__all__ = ["report_html"]
