"""Report a study's session logs as tables, statistics, figures and one HTML page."""
