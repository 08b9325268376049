// What the gallery and the level editor share: the keys of actions, kept files and links.

export const KEYS = {
  ArrowLeft: ["left", "turn_left"], ArrowRight: ["right", "turn_right"], ArrowUp: ["forward", "move_forward"],
  ArrowDown: ["move_back"], " ": ["toggle"], Enter: ["done"], p: ["pickup"], d: ["drop"],
}; // a world has one of a key's actions, or none
const LABELS = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", " ": "space", Enter: "enter" };
export const $ = (id) => document.getElementById(id);

/** The key map that an episode is played with: the keys of this page that have one of its actions. */
export function keyMapOf(actions) {
  return Object.fromEntries(Object.entries(KEYS).flatMap(([key, known]) => {
    const action = known.find((one) => actions.includes(one));
    return action ? [[key, action]] : [];
  }));
}

/** Have a text saved as a file. */
export function saveFile(text, name, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
}

/** Copy the page's address, and say so on its button. */
export async function copyLink(button, hash = location.hash) {
  const address = new URL(hash, location.href).href, text = button.textContent;
  try {
    await navigator.clipboard.writeText(address);
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = text; }, 1500);
  } catch { // a browser that lets no page write there
    prompt("The link:", address);
  }
}

/** Buttons for those of the actions that have a key. */
export function actionButtons(actions, act) {
  return Object.entries(KEYS).flatMap(([key, known]) => {
    const action = known.find((one) => actions.includes(one));
    if (!action) return [];
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = `${action.replaceAll("_", " ")} (${LABELS[key] ?? key})`;
    made.addEventListener("click", (event) => act(action, key, event, true));
    return [made];
  });
}

/** Whether the focused control takes the key: a field takes every key, any other control Space and Enter. */
function isForControl({ key, target }) {
  if (target.closest("select, textarea, input:not([type=checkbox])")) return true;
  return (key === " " || key === "Enter") && target.closest("button, input, summary, a") !== null;
}

/** Act on keys that have one of the present actions, unless the focused control takes them. */
export function onActionKeys(act, actions) {
  addEventListener("keydown", (event) => {
    const action = KEYS[event.key]?.find((one) => actions().includes(one));
    if (!action || isForControl(event)) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act(action, event.key, event, false);
  });
}

/** Give the keys back to the world after a click on a button; a button that a key pressed keeps the focus. */
export function releaseClickedButtons() {
  addEventListener("click", ({ detail, target }) => {
    if (detail > 0) target.closest("button")?.blur();
  });
}

/** What came of an episode, in a sentence. */
export function outcomeOf(done, reward, steps) {
  if (!done.terminated && !done.truncated) return "";
  const how = done.terminated ? (done.reward > 0 ? "Success" : "Over") : "Out of steps";
  return `${how}: reward ${reward.toFixed(3)} in ${steps} steps.`;
}
