"""One policy: what it observes, its network, its file, and how it acts and is evaluated."""
