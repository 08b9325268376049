"""Sessions in a browser: the same sessions and logs as in a desktop window, over a network connection.

Only ``server`` imports a network library.
"""
