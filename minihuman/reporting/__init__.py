"""Report: session logs of a study as tables, statistics, figures and one HTML page."""
