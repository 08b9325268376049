"""Questions of kind `likert`: rate one statement or several on a scale of points."""
