"""The kinds of part that a session can have, one module each."""
