"""A recorded study as data: sessions, annotations, selection, measures and tables."""
