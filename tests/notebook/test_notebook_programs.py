"""The widget where people use it: in JupyterLab and in marimo, played by real keys; Python has the episodes."""

import json
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import pytest

from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.notebook.cell_page import list_errors
from tests.programs import running, stop
from tests.web.browser import browsing

pytestmark = [pytest.mark.program, pytest.mark.nightly, needs("chromium"), needs("notebooks")]
WORLD = "minihuman/MiniGrid-FourRooms-v0"
KEYS = {"left": "ArrowLeft", "right": "ArrowRight", "forward": "ArrowUp", "toggle": "Space", "pickup": "p", "drop": "d"}
EPISODES = count(3, 100)
PICTURE_S = 2.0  # from a cell's run to its picture, once the world was shown before
CANVAS = "canvas[role=application]"
SHOW = f"""import minihuman
w = minihuman.widget({WORLD!r}, seed=range({EPISODES}), view="full")
w"""
MARIMO = f"""import marimo
app = marimo.App()

@app.cell
def _():
    import marimo as mo
    import minihuman
    w = mo.ui.anywidget(minihuman.widget({WORLD!r}, seed=range({EPISODES}), view="full"))
    again = mo.ui.run_button(label="Show another")
    mo.vstack([w, again])
    return again, minihuman, mo, w

@app.cell
def _(mo, w):
    played = w.widget.episodes if w.value["played"] else ()
    mo.md("PLAYED " + " ".join(f"{{e.seed}}={{e.outcome}}={{e.steps}}" for e in played))
    return

@app.cell
def _(again, minihuman, mo):
    mo.ui.anywidget(minihuman.widget({WORLD!r}, seed=7, view="full")) if again.value else None
    return

if __name__ == "__main__":
    app.run()
"""


def find_solutions() -> list[list[str]]:
    env = gymnasium.make(WORLD).unwrapped
    solutions = []
    for seed in range(EPISODES):
        env.reset(seed=seed)
        solutions.append([env.action_names[action] for action in env.shortest_path()])
    return solutions


@contextmanager
def serving(folder: Path, *arguments: str) -> Iterator[str]:
    """A notebook program; yields its address once it answers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", *(word.replace("PORT", str(port)) for word in arguments)]
    environment = {**os.environ, "MARIMO_SKIP_UPDATE_CHECK": "1", "HOME": str(folder)}
    with (
        (folder / "program.log").open("wb") as log,
        running(command, cwd=folder, env=environment, stdout=log, stderr=log) as program,
    ):
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                assert program.poll() is None, (folder / "program.log").read_text()
                time.sleep(0.3)
        yield f"http://127.0.0.1:{port}"
        stop(program)


def play(page: Any, solutions: list[list[str]]) -> None:
    """Play the cell's episodes one after the other."""
    status = page.locator(".minihuman-status")  # marimo has it in a shadow tree, which locators look into
    for number, solution in enumerate(solutions):
        status.filter(has_text=f"seed {number} ").wait_for()
        page.locator(CANVAS).focus()
        for action in solution:
            page.keyboard.press(KEYS[action])
        status.filter(has_text="Goal").wait_for()
        if number + 1 < len(solutions):
            page.locator(".minihuman-cell button").click()


def expected(solutions: list[list[str]]) -> str:
    # no colons: marimo's Markdown makes ":goal:" an emoji
    return "PLAYED " + " ".join(f"{seed}=goal={len(solution)}" for seed, solution in enumerate(solutions))


def keep_picture(page: Any, name: str) -> None:
    """Keep a picture where MINIHUMAN_PICTURES names a folder."""
    if folder := os.environ.get("MINIHUMAN_PICTURES"):
        page.screenshot(path=str(Path(folder) / name))


def test_a_world_is_played_in_jupyterlab(tmp_path):
    solutions = find_solutions()
    read = 'print("PLAYED", *(f"{e.seed}={e.outcome}={e.steps}" for e in w.episodes)); print(w.save("mine"))'
    cells = [
        {"cell_type": "code", "id": f"c{n}", "metadata": {}, "execution_count": None, "outputs": [], "source": source}
        for n, source in enumerate([SHOW, SHOW, read])
    ]
    notebook = {"cells": cells, "metadata": {"kernelspec": {"name": "python3", "display_name": "Python 3"}}}
    (tmp_path / "play.ipynb").write_text(json.dumps(notebook | {"nbformat": 4, "nbformat_minor": 5}))
    server = (
        "jupyterlab",
        "--no-browser",
        "--allow-root",
        "--port=PORT",
        "--IdentityProvider.token=",
        "--ServerApp.open_browser=False",
    )
    with serving(tmp_path, *server) as address, browsing() as sit_down:
        person = sit_down(f"{address}/lab/tree/play.ipynb")
        page = person.page
        editors = page.locator(".jp-CodeCell .cm-content")
        editors.first.click()
        page.wait_for_selector("[data-status=idle]")
        page.keyboard.press("Shift+Enter")
        page.wait_for_selector(CANVAS)
        editors.nth(1).click()
        began_s = time.monotonic()
        page.keyboard.press("Shift+Enter")
        page.wait_for_function(f"document.querySelectorAll({CANVAS!r}).length === 2")
        took_s = time.monotonic() - began_s
        page.locator(".jp-CodeCell").first.evaluate("cell => cell.querySelector('.minihuman-cell').remove()")
        play(page, solutions)
        keep_picture(page, "jupyterlab.png")
        editors.nth(2).click()
        page.keyboard.press("Shift+Enter")
        page.wait_for_function("document.body.innerText.includes('PLAYED ')")
        assert expected(solutions) in " ".join(page.inner_text(".jp-Notebook").split())
        assert page.locator(".jp-CodeCell").count() >= 3  # no key of the game made, moved or deleted a cell
        assert not list_errors(person)
    print(f"JupyterLab: {took_s:.2f} s from the run to the picture")
    assert list((tmp_path / "mine").rglob("*.mcap"))


def test_a_world_is_played_in_marimo(tmp_path):
    solutions = find_solutions()
    (tmp_path / "play.py").write_text(MARIMO)
    server = ("marimo", "run", "play.py", "--headless", "--port", "PORT", "--host", "127.0.0.1", "--no-token")
    with serving(tmp_path, *server) as address, browsing() as sit_down:
        person = sit_down(address)
        person.page.wait_for_selector(CANVAS)
        play(person.page, solutions)
        person.page.get_by_text(expected(solutions)).wait_for()
        keep_picture(person.page, "marimo.png")
        began_s = time.monotonic()
        person.page.get_by_role("button", name="Show another").click()
        person.page.locator(CANVAS).nth(1).wait_for()
        took_s = time.monotonic() - began_s
        assert not list_errors(person)
    print(f"marimo: {EPISODES} episodes, each replayed in Python; {took_s:.2f} s from the run of a cell to its picture")
