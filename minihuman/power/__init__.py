"""How many participants a study needs: people from a pool, drawn into studies, put to the report's own test."""
