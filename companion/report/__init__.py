"""A flight's examination as one HTML file that needs no network, and what such pages are made of."""

from companion.present import markup
from companion.report.charts import Charts, laid_out
from companion.report.errors_over_time import error_panels
from companion.report.html_page import Section, sheet
from companion.report.incident import incident_html
from companion.report.page import bare_html, report_html
from companion.report.plot import plot_drift, plot_errors, plot_path
from companion.report.traces import TIME, Figure, Panel, Trace, curve, stack
from companion.report.track_and_altitude import ground_track
