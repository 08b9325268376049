"""Agent blocks: code shared by takeover and rating, in which an agent plays a block at a fixed pace."""
