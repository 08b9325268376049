"""The response of a trial in which the participant gave none, by the name that worlds and tables have for it.

It is apart from the worlds of trials, which draw: who reads a table of trials needs neither Gymnasium nor typefaces.
"""

NO_RESPONSE = "none"
