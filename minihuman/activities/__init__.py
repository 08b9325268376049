"""Activities: the kinds of part that a session can have, a folder for each.

A folder has all of its kind: the plan, the activity with its events and screens, log rows, tables, figures and the
page's code. Nothing else knows a kind by name: the entry points of the group `minihuman.activities` list them, and
`minihuman.experiment.machine.activity` loads them.
"""
