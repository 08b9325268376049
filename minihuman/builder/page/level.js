// A level as a grid of cells of two characters: its file, and the first state that the rules take.
// The characters, the file and the state are those of minihuman/Level-v0. The live gallery's editor uses it, too.

/** @type {Record<string, number>} */
const LETTERS = { W: 2, F: 3, K: 5, A: 6, B: 7, G: 8, V: 9 };
/** @type {Record<string, number>} */
const DOORS = { O: 0, D: 1, L: 2 };
const COLOURS = "rgbpy-";
export const WORLD = "minihuman/Level-v0";
export const AGENTS = [">>", "vv", "<<", "^^"]; // by direction
const DOOR = 4, EMPTY = 1, GREY_WALL = 2 | 5 << 4, FIRST_WITH_IDENTITY = 4, LAST_WITH_IDENTITY = 7;
const HEADER = 24, CARRYING = 5, PHASE = 8, PLAYING = 1;
const FILE = /^world *= *"minihuman\/Level-v0"[^]*?^options\.mission *= *("(?:[^"\\]|\\.)*")[^]*?^options\.diagram *= *'''\r?\n([^]*?)'''/m;

export class Level {
  /** @param {number} width in cells @param {number} height */
  constructor(width, height) {
    this.mission = "get to the green goal square";
    /** @type {string[][]} by row */
    this.cells = Array.from({ length: height }, (_, y) => Array.from({ length: width }, (_, x) =>
      isBorder(x, y, width, height) ? "WW" : "  "));
  }

  /** A level to begin with: a room with the agent and a goal. */
  static start() {
    const level = new Level(9, 7);
    level.put(1, 1, ">>");
    level.put(7, 5, "Gg");
    return level;
  }

  get width() { return this.cells[0].length; }
  get height() { return this.cells.length; }

  /**
   * Put a cell; a second agent takes the place of the first, and an empty border is a wall.
   * @param {number} x @param {number} y @param {string} cell
   */
  put(x, y, cell) {
    if (AGENTS.includes(cell)) {
      this.cells = this.cells.map((row, v) => row.map((other, u) => (AGENTS.includes(other) ? this.#empty(u, v) : other)));
    }
    this.cells[y][x] = cell === "  " ? this.#empty(x, y) : cell;
  }

  /** @param {number} x @param {number} y */
  #empty(x, y) { return isBorder(x, y, this.width, this.height) ? "WW" : "  "; }

  /** The level in another size; what lies outside of it goes. @param {number} width @param {number} height */
  resized(width, height) {
    const resized = new Level(width, height);
    resized.mission = this.mission;
    for (let y = 1; y < Math.min(height, this.height) - 1; y++) {
      for (let x = 1; x < Math.min(width, this.width) - 1; x++) resized.cells[y][x] = this.cells[y][x];
    }
    return resized;
  }

  /** The actions that can matter in it. */
  get actions() {
    const letters = new Set(this.cells.flat().map((cell) => cell[0]));
    const carries = ["K", "A", "B"].some((letter) => letters.has(letter));
    const opens = ["D", "L", "O", "B"].some((letter) => letters.has(letter));
    return ["left", "right", "forward", ...(carries ? ["pickup", "drop"] : []), ...(opens ? ["toggle"] : [])];
  }

  /** The level's file: lines of a block in a protocol. */
  get file() {
    const lines = this.cells.map((row) => row.join("").trimEnd()).join("\n");
    const actions = this.actions.map((action) => `"${action}"`).join(", ");
    const head = `world = "minihuman/Level-v0"\nactions = [${actions}]\nmax_steps = ${4 * this.width * this.height}\n`;
    return `${head}options.mission = ${JSON.stringify(this.mission)}\noptions.diagram = '''\n${lines}\n'''\n`;
  }

  /** Whether its first state is the same each time: the agent is drawn. */
  get isFixed() { return this.cells.flat().some((cell) => AGENTS.includes(cell)); }

  /** The options by which Python makes it. */
  get options() {
    return { mission: this.mission, diagram: this.cells.map((row) => row.join("").trimEnd()).join("\n") };
  }

  /** Read a file; null if it is not one. @param {string} text */
  static read(text) {
    const [, mission, diagram] = FILE.exec(text) ?? [];
    if (diagram === undefined) return null;
    return Level.fromDiagram(diagram, JSON.parse(mission));
  }

  /** Read a diagram, as a block's options have it; null if it has other characters. @param {string} diagram @param {string} mission */
  static fromDiagram(diagram, mission) {
    const shown = diagram.replace(/\r/g, "").replace(/^[ \t]+$/gm, "").replace(/^\n+|\n+$/g, "").split("\n");
    const indent = Math.min(...shown.filter(Boolean).map((line) => line.search(/\S/)));
    const lines = shown.map((line) => line.slice(indent)); // common indentation is no cells, as in Python
    const width = Math.max(...lines.map((line) => Math.ceil(line.length / 2)));
    const level = new Level(width, lines.length);
    level.mission = mission;
    level.cells = lines.map((line) => Array.from({ length: width }, (_, x) => line.slice(2 * x, 2 * x + 2).padEnd(2)));
    return level.cells.flat().every((cell) => codeOf(cell, 0) !== undefined) ? level : null;
  }

  /** What is missing before it can be played; empty if nothing is. */
  get problem() {
    const cells = this.cells.flat();
    if (!cells.some((cell) => AGENTS.includes(cell)) && !cells.includes("  ")) return "There is no empty cell for the agent.";
    return cells.some((cell) => cell[0] === "G") ? "" : "Without a goal square, an episode ends at the step limit.";
  }

  /** The first state, as an array of int32; an agent that is not drawn stands in an empty cell, `at` of 0 to 1. */
  row(at = Math.random()) {
    const { width, height } = this, area = width * height;
    const row = new Int32Array(HEADER + 3 * area);
    row.set([width, height, 0, 0, 0, EMPTY, 0, 4 * area, PLAYING, 0, 7]);
    row[CARRYING] = EMPTY;
    row[PHASE] = PLAYING;
    let objects = 0;
    /** @type {number[][]} */
    const empty = [];
    this.cells.forEach((line, y) => line.forEach((cell, x) => {
      const direction = AGENTS.indexOf(cell), place = x * height + y;
      if (direction >= 0) row.set([x, y, direction], 2);
      if (cell === "  ") empty.push([x, y, Math.floor(at * 4)]);
      const code = codeOf(direction >= 0 ? "  " : cell, objects + 1) ?? EMPTY;
      if (code >> 9) row[HEADER + area + objects++] = place;
      row[HEADER + place] = code;
    }));
    row[11] = objects;
    if (!this.cells.flat().some((cell) => AGENTS.includes(cell))) row.set(empty[Math.floor(at * empty.length)] ?? [1, 1, 0], 2);
    return row;
  }
}

/** @param {number} x @param {number} y @param {number} width @param {number} height */
function isBorder(x, y, width, height) { return x === 0 || y === 0 || x === width - 1 || y === height - 1; }

/**
 * The number of a cell; `identity` is that of an object. Undefined for characters that mean nothing.
 * @param {string} cell @param {number} [identity] @returns {number | undefined}
 */
export function codeOf(cell, identity = 0) {
  if (cell === "  " || AGENTS.includes(cell)) return EMPTY;
  if (cell === "WW") return GREY_WALL;
  const colour = COLOURS.indexOf(cell[1]), state = DOORS[cell[0]] ?? 0;
  const kind = cell[0] in DOORS ? DOOR : LETTERS[cell[0]];
  if (colour < 0 || kind === undefined) return undefined;
  const isObject = kind >= FIRST_WITH_IDENTITY && kind <= LAST_WITH_IDENTITY;
  return kind | colour << 4 | state << 7 | (isObject ? identity : 0) << 9;
}
