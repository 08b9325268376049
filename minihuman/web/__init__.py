"""Sessions in a browser: the same session and the same log as at a window, over a network connection.

Only ``server`` imports a network library.
"""
