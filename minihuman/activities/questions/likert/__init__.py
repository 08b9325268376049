"""Questions of kind `likert`: points on a scale, for one statement or several."""
