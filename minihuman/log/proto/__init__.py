"""Protobuf messages of the log.

``minihuman_v1.proto`` is the one source; its first lines say how the Python is generated from it.
"""
