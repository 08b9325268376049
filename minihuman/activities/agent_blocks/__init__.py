"""Agent blocks: what takeover and rating share, blocks that an agent plays at a fixed pace."""
