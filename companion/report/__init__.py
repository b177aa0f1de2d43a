"""A flight's examination as one HTML file that needs no network, and what such pages are made of."""

from companion.report.drift import plot_drift, plot_errors, plot_path
from companion.report.html_page import Charts, Section, laid_out, sheet
from companion.report.incident import incident_html
from companion.report.page import report_html
from companion.report.traces import TIME, Figure, Panel, curve, stack
