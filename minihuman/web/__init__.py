"""A browser is a window: the same session and the same log, over a line. Parts named `server` and `door` do I/O."""
