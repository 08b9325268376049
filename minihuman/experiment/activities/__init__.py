"""Activities: the kinds of part that a session can have, one module or package per kind."""
