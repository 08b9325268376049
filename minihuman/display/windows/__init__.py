"""Windows: where screens are shown and keys come from."""
