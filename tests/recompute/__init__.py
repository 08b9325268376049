"""A study's numbers recomputed from its MCAP logs, enrolment log and annotations by a program without minihuman.

``python -m tests.recompute STUDY`` compares what a folder of outputs says with the logs. Beside it stand the protocols
of six invented laboratories and ``play``, which plays them as people do: killed, resumed, withdrawn, excluded.
"""
