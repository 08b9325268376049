"""A laboratory's package, as small as it can be: a kind of activity, a kind of question, an exporter and a column."""
