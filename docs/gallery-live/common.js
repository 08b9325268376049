// What the gallery and the level editor share: packed files, tiles, and the keys of actions.

export const ROW_STEP = 6;
export const MAX_STEPS = 7;
export const KEYS = {
  ArrowLeft: ["left", "turn_left"], ArrowRight: ["right", "turn_right"], ArrowUp: ["forward", "move_forward"],
  ArrowDown: ["move_back"], " ": ["toggle"], Enter: ["done"], p: ["pickup"], d: ["drop"],
}; // a world has one of a key's actions, or none
const LABELS = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", " ": "space", Enter: "enter" };
export const $ = (id) => document.getElementById(id);

export async function unpack(path) {
  const packed = (await fetch(path)).body.pipeThrough(new DecompressionStream("deflate"));
  return new Response(packed).arrayBuffer();
}

/** The list of worlds, and the tiles that they are drawn with. */
export async function loadIndex() {
  const [index, packed] = await Promise.all([fetch("index.json").then((got) => got.json()), unpack("atlas.z")]);
  const atlas = { tile_px: index.atlas.tile_px, small_px: index.atlas.small_px };
  for (const [name, { at, bytes, kind }] of Object.entries(index.atlas.arrays)) {
    const part = packed.slice(at, at + bytes);
    atlas[name] = kind === "int64" ? new BigInt64Array(part) : new Uint8Array(part);
  }
  return { index, atlas };
}

/** Put a picture onto a canvas, which takes its size. */
export function show(picture, canvas) {
  const { width, height } = picture;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  picture.paint(canvas);
}

/** Buttons for those of the actions that have a key. */
export function actionButtons(actions, act) {
  return Object.entries(KEYS).flatMap(([key, known]) => {
    const action = known.find((one) => actions.includes(one));
    if (!action) return [];
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = `${action.replaceAll("_", " ")} (${LABELS[key] ?? key})`;
    made.addEventListener("click", () => act(action));
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
    act(action);
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
  if (done.status <= 0) return "";
  const how = done.status & 1 ? (done.reward > 0 ? "Success" : "Over") : "Out of steps";
  return `${how}: reward ${reward.toFixed(3)} in ${steps} steps.`;
}
