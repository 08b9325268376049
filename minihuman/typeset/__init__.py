"""Type: faces for every script, the width of words, lines and pages. Measures and sets; knows no screens."""
