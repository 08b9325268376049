"""Windows, which show screens and receive keys."""
