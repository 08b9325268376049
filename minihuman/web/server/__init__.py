"""The web server: the only part of ``web`` that imports Starlette and uvicorn."""
