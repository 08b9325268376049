"""Report: a folder of session logs into tables, statistics, figures and one page."""
