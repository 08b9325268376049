"""Names in a log that are known without its message types: its version, metadata records, the topic of its steps."""

SCHEMA_VERSION = 1  # of the messages; goes up when an older reader would misread a newer log
PROFILE = "minihuman"

SEGMENT_METADATA = "minihuman.segment"  # at a segment's start
FACTS_METADATA = "minihuman.facts"
END_METADATA = "minihuman.end"  # added when the segment is finished
FINISHED_LOG_WAS = "the finished log was "  # how the damage is told that took the end of a finished log
REPAIRED_METADATA = "minihuman.repaired"  # added when a finished log is rewritten because it was damaged
MISSING_METADATA = "minihuman.missing"  # added for messages that were lost to damage

STEP = "/step"
