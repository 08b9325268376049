"""Exporters: one file per format, each with one entry point."""
