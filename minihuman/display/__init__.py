"""Show screens and read keys: windows, the drawing of every screen, and text layout."""
