"""Questions: a folder for each kind, and the questionnaire that asks them."""
