"""Any Gymnasium environment behind one face."""
