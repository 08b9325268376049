"""Recorded sessions as values. This package opens no file and does not know the log's format."""
