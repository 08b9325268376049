"""Questions: the questionnaire activity, and a folder for each kind of question."""
