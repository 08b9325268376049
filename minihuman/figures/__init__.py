"""Figures: functions that draw data on an axes and return the axes. Nothing here opens a log or shows a window."""
