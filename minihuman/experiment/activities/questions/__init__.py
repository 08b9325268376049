"""Questions: a file for each kind, and the questionnaire that asks them."""
