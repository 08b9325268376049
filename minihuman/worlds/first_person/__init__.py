"""First-person worlds: rooms, entities, motion rules and a CPU renderer."""
