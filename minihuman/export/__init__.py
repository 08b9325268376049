"""Exporters: one file, one format, one entry point."""
