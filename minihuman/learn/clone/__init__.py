"""Cloning: policies learned from demonstrations."""
