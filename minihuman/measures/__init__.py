"""Measures: numbers from one episode or one session. Pure: no file, no clock, no drawing."""
