// The level editor of a block: draw a grid of cells; each stroke is written to the block's options, and the preview plays it.
/** @import { Edit, WorldInfo } from "./messages" */
/** @import { FieldPath, OpenStudy } from "./open_study.js" */
import { html, useEffect, useRef, useState } from "./vendor/preact.js";
import { AGENTS, Level, WORLD } from "./level.js";
import { TextInput } from "./text_input.js";
import { buildAddress, describeWorld } from "./requests.js";

const COLOURS = /** @type {Record<string, string>} */ ({ r: "red", g: "green", b: "blue", p: "purple", y: "yellow", "-": "grey" });
const KINDS = /** @type {Record<string, string>} */ ({
  "  ": "empty", WW: "wall", ">>": "agent", G: "goal", V: "lava", F: "floor", K: "key", A: "ball", B: "box",
  D: "door", L: "locked door", O: "open door",
});
const FIXED_COLOURS = /** @type {Record<string, string>} */ ({ G: "g", V: "r" });
const DIRECTIONS = ["right", "down", "left", "up"];
const STEPS = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] });
const [LEAST, MOST] = [3, 25]; // cells of a side

/** @param {string} cell */
export const cellPicture = (cell) => buildAddress("api/cell.png", { cell });

/** @param {string} cell @returns {string} what a cell is, in words */
export function nameCell(cell) {
  const direction = AGENTS.indexOf(cell);
  if (direction >= 0) return `agent, looking ${DIRECTIONS[direction]}`;
  if (cell in KINDS) return KINDS[cell];
  const kind = KINDS[cell[0]] ?? cell;
  return cell[0] in FIXED_COLOURS ? kind : `${COLOURS[cell[1]] ?? ""} ${kind}`.trim();
}

/** @param {string} tool @param {string} colour @param {string} before @returns {string} what a tool puts in place of a cell */
export function chooseCell(tool, colour, before) {
  if (tool === ">>") return AGENTS[(AGENTS.indexOf(before) + 1) % AGENTS.length];
  return tool.length === 2 ? tool : tool + (FIXED_COLOURS[tool] ?? colour);
}

/**
 * The edits that write a level into a block: its options, and the actions and keys that it needs and the block lacks.
 * @param {any} block @param {FieldPath} path of the block @param {Level} level @param {WorldInfo | null} facts @returns {Edit[]}
 */
export function buildLevelEdits(block, path, level, facts) {
  /** @type {Edit[]} */
  const edits = [];
  const { diagram, mission } = level.options;
  if (readLevel(block.options)?.options.diagram !== diagram || !block.options?.diagram) edits.push({ op: "set", path: [...path, "options", "diagram"], value: `${diagram}\n` });
  if (block.options?.mission !== mission) edits.push({ op: "set", path: [...path, "options", "mission"], value: mission });
  const lacking = level.actions.filter((action) => !(block.actions ?? []).includes(action));
  if (!lacking.length) return edits;
  edits.push({ op: "set", path: [...path, "actions"], value: [...(block.actions ?? []), ...lacking] });
  const keys = Object.entries(facts?.default_keys ?? {}).filter(([, action]) => lacking.includes(action));
  if (block.fixed_keys) edits.push({ op: "set", path: [...path, "fixed_keys"], value: { ...block.fixed_keys, ...Object.fromEntries(keys) } });
  return edits;
}

/** @param {any} options of a block @returns {Level | null} null if the diagram cannot be shown as cells */
function readLevel(options) {
  if (typeof options?.diagram !== "string") return Level.start();
  return Level.fromDiagram(options.diagram, options.mission ?? "get to the green goal square");
}

/** @param {{ study: OpenStudy, path: FieldPath }} properties */
export function LevelEditor({ study, path }) {
  const block = study.read(path);
  const [drawn, setDrawn] = useState(/** @type {Level | null} */ (null)); // of a stroke that goes on
  const [facts, setFacts] = useState(/** @type {WorldInfo | null} */ (null));
  const [tool, setTool] = useState({ kind: "WW", colour: "y" });
  useEffect(() => { describeWorld(WORLD).then(setFacts, () => {}); }, []);
  const level = drawn ?? readLevel(block.options);
  if (!level) return html`<p class="quiet">This level has cells that the editor does not know; edit its diagram in the view “File”.</p>`;
  const isFixed = study.restrictionAt([...path, "options"]) !== "";
  const save = (/** @type {Level} */ changed) => {
    const edits = buildLevelEdits(study.read(path), path, changed, facts);
    if (edits.length) study.edit(edits);
    setDrawn(null);
  };
  const resize = (/** @type {number} */ width, /** @type {number} */ height) => {
    const limit = (/** @type {number} */ count) => Math.min(MOST, Math.max(LEAST, Math.round(count) || LEAST));
    save(level.resized(limit(width), limit(height)));
  };
  return html`<section class="level" aria-label="Level"><h3>Level</h3>
    ${!isFixed && html`<${Palette} tool=${tool} choose=${setTool} />`}
    <${Grid} level=${level} tool=${tool} isFixed=${isFixed} show=${setDrawn} save=${save} />
    <p class="quiet">${level.problem || "Click or drag to draw; a click on the agent turns it. The preview plays the level."}</p>
    <div class="row"><label>Columns <${TextInput} type="number" min=${LEAST} max=${MOST} value=${level.width} disabled=${isFixed}
        save=${(/** @type {string} */ count) => resize(Number(count), level.height)} /></label>
      <label>Rows <${TextInput} type="number" min=${LEAST} max=${MOST} value=${level.height} disabled=${isFixed}
        save=${(/** @type {string} */ count) => resize(level.width, Number(count))} /></label>
      <label class="wide">Mission <${TextInput} dir="auto" value=${level.mission} disabled=${isFixed} save=${(/** @type {string} */ mission) => {
        level.mission = mission;
        save(level);
      }} /></label></div></section>`;
}

/** @param {{ tool: { kind: string, colour: string }, choose: (tool: { kind: string, colour: string }) => void }} properties */
function Palette({ tool, choose }) {
  const hasColour = tool.kind.length === 1 && !(tool.kind in FIXED_COLOURS);
  return html`<div class="palette" role="group" aria-label="What to draw">${Object.entries(KINDS).map(([kind, name]) => html`
      <button type="button" key=${kind} aria-pressed=${tool.kind === kind} onClick=${() => choose({ ...tool, kind })}>
        <img src=${cellPicture(chooseCell(kind, tool.colour, ""))} alt="" width="24" height="24" /> ${name}</button>`)}</div>
    ${hasColour && html`<div class="palette" role="group" aria-label="Its colour">${Object.entries(COLOURS).map(([colour, name]) => html`
      <button type="button" key=${colour} aria-pressed=${tool.colour === colour} onClick=${() => choose({ ...tool, colour })}>
        <img src=${cellPicture(tool.kind + colour)} alt="" width="24" height="24" /> ${name}</button>`)}</div>`}`;
}

/** @param {any} properties */
function Grid({ level, tool, isFixed, show, save }) {
  const stroke = useRef(/** @type {Level | null} */ (null));
  const [cursor, setCursor] = useState(/** @type {[number, number]} */ ([1, 1]));
  const [x, y] = [Math.min(cursor[0], level.width - 1), Math.min(cursor[1], level.height - 1)];
  const put = (/** @type {number} */ column, /** @type {number} */ row) => {
    const changed = stroke.current ?? Level.fromDiagram(level.options.diagram, level.mission);
    if (!changed || isFixed) return null;
    changed.put(column, row, chooseCell(tool.kind, tool.colour, changed.cells[row][column]));
    setCursor([column, row]);
    return changed;
  };
  const locate = (/** @type {any} */ event) => {
    const box = event.currentTarget.getBoundingClientRect();
    const column = Math.floor((event.clientX - box.left) / box.width * level.width);
    const row = Math.floor((event.clientY - box.top) / box.height * level.height);
    return column >= 0 && row >= 0 && column < level.width && row < level.height ? [column, row] : null;
  };
  const draw = (/** @type {any} */ event) => {
    const place = locate(event);
    if (!place || (stroke.current && place[0] === x && place[1] === y)) return;
    stroke.current = put(place[0], place[1]);
    show(stroke.current && Object.assign(new Level(3, 3), stroke.current));
  };
  const begin = (/** @type {any} */ event) => {
    event.currentTarget.setPointerCapture(event.pointerId);
    draw(event);
  };
  const end = () => {
    if (stroke.current) save(stroke.current);
    stroke.current = null;
  };
  const press = (/** @type {any} */ event) => {
    const step = STEPS[event.key];
    if (!step && event.key !== " " && event.key !== "Enter") return;
    event.preventDefault();
    if (step) return setCursor([Math.min(level.width - 1, Math.max(0, x + step[0])), Math.min(level.height - 1, Math.max(0, y + step[1]))]);
    const changed = put(x, y);
    if (changed) save(changed);
  };
  return html`<div class="cells-grid" role="application" tabindex="0" aria-label="Cells of the level; arrow keys move, Space draws" aria-describedby="level-cursor"
      style=${{ gridTemplateColumns: `repeat(${level.width}, 1fr)`, maxWidth: `${level.width * 40}px` }} onKeyDown=${press}
      onPointerDown=${begin} onPointerMove=${(/** @type {any} */ event) => stroke.current && draw(event)} onPointerUp=${end} onPointerCancel=${end}>
      ${level.cells.map((/** @type {string[]} */ row, /** @type {number} */ v) => row.map((cell, u) => html`
        <img key=${`${u} ${v}`} src=${cellPicture(cell)} alt="" draggable=${false} class=${u === x && v === y ? "cursor" : ""} />`))}</div>
    <p id="level-cursor" class="quiet" role="status">Column ${x + 1}, row ${y + 1}: ${nameCell(level.cells[y][x])}</p>`;
}
