"""A page with a notebook's cell in Chromium: the cell's module with a model of its own, as anywidget gives it one."""

import base64
import json
from pathlib import Path
from typing import Any

import minihuman
from minihuman.notebook.cell_world import CellWorld, read_modules

FOLDER = Path(minihuman.__file__).parent / "notebook"
_SHOW = """async ([cell, css, state, pack]) => {
  const bytes = Uint8Array.from(atob(pack), (letter) => letter.charCodeAt(0));
  const kept = { ...state, pack: new DataView(bytes.buffer), played: [] };
  window.model = {
    get: (name) => kept[name],
    set(name, content) { kept[name] = content; },
    save_changes() { window.saved = kept.played; },
  };
  const style = document.head.appendChild(document.createElement("style"));
  style.textContent = css;
  const { default: module } = await import(URL.createObjectURL(new Blob([cell], { type: "text/javascript" })));
  window.cleanUp = await module.render({ model: window.model, el: document.body });
}"""


def show_cell(page: Any, world: CellWorld) -> None:
    """Show a world's cell on a page."""
    settings = {"name": world.id, "seeds": list(map(str, world.seeds)), "view": world.view, "keys": world.keys}
    state = {"modules": read_modules(), "settings": settings}
    texts = [(FOLDER / name).read_text(encoding="utf-8") for name in ("cell.js", "cell.css")]
    page.evaluate(_SHOW, [*texts, state, base64.b64encode(world.pack).decode()])
    page.wait_for_selector("canvas[role=application]")


def play_actions(page: Any, world: CellWorld, actions: list[str]) -> None:
    """Press the keys of actions in the cell, which has the focus from then on."""
    keys = {action: key for key, action in world.keys.items()}
    page.locator("canvas").focus()
    for action in actions:
        page.keyboard.press("Space" if keys[action] == " " else keys[action])


def read_played(page: Any) -> list[dict[str, Any]]:
    """Return what the cell sent to the kernel."""
    played: list[dict[str, Any]] = json.loads(page.evaluate("JSON.stringify(window.saved ?? [])"))
    return played


def list_errors(person: Any) -> list[str]:
    """Return a page's errors, but for those of the tests' own script, as an empty page has no storage."""
    return [error for error in person.errors if "sessionStorage" not in error]
