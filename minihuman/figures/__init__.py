"""Figures: functions of data and an axes that return the axes. Nothing here opens a log or shows a window."""
