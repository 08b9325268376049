"""Exporters: one file per format, one entry point each."""
