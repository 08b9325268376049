"""The log's messages. ``minihuman_v1.proto`` is the one source; its first lines say how the Python is made from it."""
