"""Activities: the kinds of part that a session can have, with one folder for each kind.

A folder holds everything about its kind: the plan, the activity with its events and screens, log rows, tables, figures
and the page's code. Nothing else refers to a kind by name: the entry points of the group `minihuman.activities` list
the kinds, and `minihuman.experiment.machine.activity` loads them.
"""
