"""Names on disk that are known without the message types: schema version, profile, metadata records, the step topic.

They are part of the format: they stay as they are when names in the code change.
"""

SCHEMA_VERSION = 3  # the newest; increased when older readers would misread a newer log
PLAIN_SCHEMA_VERSION = 2  # of a segment that readers of version 2 read correctly
PROFILE = "minihuman"

SEGMENT_METADATA = "minihuman.segment"  # at a segment's start
FACTS_METADATA = "minihuman.facts"
END_METADATA = "minihuman.end"  # added when the segment is finished
FINISHED_LOG_WAS = "the finished log was "  # followed by the damage that destroyed its end
REPAIRED_METADATA = "minihuman.repaired"  # added when a finished log is rewritten because it was damaged
MISSING_METADATA = "minihuman.missing"  # added for messages that were lost to damage

STEP = "/step"
CHAIN_KEY = "chain"  # the fact of a segment's end that states the head of its hash chain
