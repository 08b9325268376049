"""The study: protocol, key maps, allocation, session machine, screens. No I/O."""
