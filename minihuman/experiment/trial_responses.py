"""The name by which worlds and tables record that a trial had no response.

This module is separate from the worlds of trials, which draw pictures, so that readers of trial tables need neither
Gymnasium nor typefaces.
"""

NO_RESPONSE = "none"
