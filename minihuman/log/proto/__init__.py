"""Protobuf messages of the log.

``minihuman_v1.proto`` is the only source; its first lines say how the Python code is generated from it.
"""
