"""The display of screens: windows with their keys, the drawing of every screen, and text layout."""
