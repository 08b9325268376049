"""Compiles the worlds' kernels ahead of time, to WebAssembly for the page."""
