// Grid worlds laid out from seeds, in a page or in Node, as Python lays them out: the same random numbers, the same
// compiled layouts, the same missions. `layouts.z` of a pack says which layout a world has, with which numbers.

import { CARRYING, FAILED, HEADER, HEIGHT, MISSION, PHASE, PLAYING, WIDTH } from "./row.js";

/** @import { Kernels, Start } from "./world.js" */
/**
 * @typedef {{ layout: string, numbers: number[], program: (number | string)[][], header: number[],
 * mission: { template: string, choices: Record<string, string>[] } | null }} LayoutEntry a level has a program, and a mission
 * that is an instruction; numbers that a double cannot hold are texts
 * @typedef {{ worlds: Record<string, LayoutEntry>, language: Language }} LayoutTable
 * @typedef {{ places: Record<string, number>, verbs: string[], joins: string[], colours: string[], kinds: string[],
 * sides: string[] }} Language of instructions: where in its block what is, and the words
 */

const MASK32 = 0xffffffffn, MASK64 = (1n << 64n) - 1n, MASK128 = (1n << 128n) - 1n;
const PCG_MULTIPLIER = 0x2360ed051fc65da44385df649fccf645n;
const POOL_SIZE = 4, WORDS = 6;

/**
 * The state of NumPy's generator for a seed, `default_rng(seed)`, as the six words of minihuman's kernels: NumPy's
 * SeedSequence and the seeding of PCG64. Their draws are compiled, in the layouts.
 * @param {number | bigint} seed 0 or more @returns {BigUint64Array}
 */
export function seedGenerator(seed) {
  const [high, low, streamHigh, streamLow] = generateState(mixEntropy(splitSeed(BigInt(seed))));
  const increment = ((streamHigh << 64n | streamLow) << 1n | 1n) & MASK128;
  const state = ((increment + (high << 64n | low)) * PCG_MULTIPLIER + increment) & MASK128;
  return new BigUint64Array([state >> 64n, state & MASK64, increment >> 64n, increment & MASK64, 0n, 0n]);
}

/** @param {bigint} seed @returns {number[]} words of 32 bits, the lowest first */
function splitSeed(seed) {
  if (seed < 0n) throw new Error(`seed ${seed} is negative; give 0 or more`);
  const words = [];
  do {
    words.push(Number(seed & MASK32));
    seed >>= 32n;
  } while (seed > 0n);
  return words;
}

/** A hash whose constant changes from call to call. @param {number} constant @param {number} factor */
function makeHash(constant, factor) {
  return (/** @type {number} */ word) => {
    const mixed = word ^ constant;
    constant = Math.imul(constant, factor);
    const product = Math.imul(mixed, constant);
    return (product ^ product >>> 16) >>> 0;
  };
}

/** @param {number[]} entropy @returns {number[]} the pool */
function mixEntropy(entropy) {
  const hash = makeHash(0x43b0d7e5, 0x931e8875);
  const mix = (/** @type {number} */ a, /** @type {number} */ b) => {
    const mixed = Math.imul(0xca01f9dd, a) - Math.imul(0x4973f715, b);
    return (mixed ^ mixed >>> 16) >>> 0;
  };
  const pool = Array.from({ length: POOL_SIZE }, (_, place) => hash(entropy[place] ?? 0));
  for (let from = 0; from < Math.max(POOL_SIZE, entropy.length); from++) {
    for (let to = 0; to < POOL_SIZE; to++) {
      if (from !== to) pool[to] = mix(at(pool, to), hash(from < POOL_SIZE ? at(pool, from) : at(entropy, from)));
    }
  }
  return pool;
}

/** @param {number[]} pool @returns {[bigint, bigint, bigint, bigint]} */
function generateState(pool) {
  const hash = makeHash(0x8b51f9dd, 0x58f38ded);
  const halves = Array.from({ length: 2 * POOL_SIZE }, (_, place) => BigInt(hash(at(pool, place % POOL_SIZE))));
  const word = (/** @type {number} */ place) => at(halves, 2 * place) | at(halves, 2 * place + 1) << 32n;
  return [word(0), word(1), word(2), word(3)];
}

/** @template T @param {ArrayLike<T>} numbers @param {number} place @returns {T} */
const at = (numbers, place) => /** @type {T} */ (numbers[place]);

/** A grid world's first states, each laid out when it is asked for. */
export class DrawnRows {
  #mission = "";

  /**
   * @param {Kernels} kernels of the module that has the world's layout, with room for these arrays
   * @param {LayoutTable} table @param {{ name: string, module: string, row_length: number, view_size: number }} world
   */
  constructor(kernels, table, { name, module, row_length, view_size }) {
    const layout = table.worlds[name];
    if (!layout) throw new Error(`${name} has no layout in this pack; pack it again`);
    this.name = name;
    this.module = module;
    this.kernels = kernels;
    this.layout = layout;
    this.language = table.language;
    this.view_size = view_size;
    this.row = kernels.array("int32", [row_length]);
    this.words = kernels.array("uint64", [WORDS]);
    this.clear = kernels.bind("clear", this.row);
    this.draw = kernels.bind(layout.layout, this.row, this.words, ...this.#bindArguments());
    this.handOver = layout.mission ? null : kernels.bind("hand_over", this.row);
  }

  #bindArguments() {
    const { numbers, program } = this.layout, width = program[0]?.length;
    if (!width) return numbers;
    const lines = new BigInt64Array(program.flat().map(BigInt));
    return [this.kernels.array("int64", [program.length, width], lines), this.kernels.array("int64", [0])];
  }

  /** @param {number} seed @returns {Start} */
  at(seed) {
    const { view_size } = this;
    this.row.data.fill(0);
    this.row.data.set(this.layout.header);
    this.words.data.set(seedGenerator(seed));
    this.clear.call();
    this.draw.call();
    const row = this.row.data;
    if (row[FAILED]) throw new Error(`${this.name} with seed ${seed} has no free cell for something; use another seed`);
    row[PHASE] = PLAYING;
    this.#mission = this.layout.mission ? fillTemplate(row, this.layout.mission) : writeInstruction(row, this.language);
    const first_row = row.slice();
    this.handOver?.call();
    const words = this.words.data.slice(), start = { row: this.row.data.slice(), words, view_size };
    return start.row[CARRYING] === first_row[CARRYING] ? start : { ...start, first_row };
  }

  /** The mission of the episode that was laid out last. */
  mission() { return this.#mission; }
}

/** @param {Int32Array} row @param {{ template: string, choices: Record<string, string>[] }} mission */
function fillTemplate(row, { template, choices }) {
  const words = choices.map((choice, place) => choice[at(row, MISSION + place)]);
  return template.replaceAll("{}", () => words.shift() ?? "");
}

/** The instruction of a row as a sentence. @param {Int32Array} row @param {Language} language */
export function writeInstruction(row, { places, verbs, joins, colours, kinds, sides }) {
  const block = HEADER + 3 * at(row, WIDTH) * at(row, HEIGHT);
  const number = (/** @type {number} */ from, /** @type {string} */ name) => at(row, from + (places[name] ?? NaN));
  const describe = (/** @type {number} */ from) => [
    number(from, "PLURAL") ? "a" : "the", colours[number(from, "COLOUR")], kinds[number(from, "KIND")] ?? "object",
    sides[number(from, "PLACE")],
  ].filter(Boolean).join(" ");
  const clauses = Array.from({ length: number(block, "LEFT") + number(block, "RIGHT") }, (_, place) => {
    const clause = block + (places.CLAUSES ?? NaN) + place * (places.CLAUSE ?? NaN);
    const words = at(verbs, number(clause, "VERB")).replace("{}", describe(clause + (places.THING ?? NaN)));
    return words.replace("{}", () => describe(clause + (places.OTHER ?? NaN)));
  });
  const left = clauses.slice(0, number(block, "LEFT")).join(" and ");
  return clauses.length === number(block, "LEFT") ? left
    : `${left}${at(joins, number(block, "JOIN"))}${clauses.slice(number(block, "LEFT")).join(" and ")}`;
}
