// What is kept of an episode that a page computes: columns, from which Python plays it again (`minihuman import`).
// Times are the page's word, in ms after the first picture; keys are `KeyboardEvent.key`, letters in lower case.

/** @import { StepResult, World } from "./packed_world.js" */
/**
 * @typedef {"terminated" | "truncated" | "time_limit" | "left"} EpisodeEnd how it ended
 * @typedef {{ world: string, options: Record<string, unknown>, seed: number, view: string, key_map: Record<string, string>,
 * keys: string[], actions: number[], rt_ms: number[], held_ms: (number | null)[], rewards: number[], digests: string,
 * buttons: number[], untrusted: number[], end: EpisodeEnd, time_limit_ms: number, playing_ms: number, reward: number, success: boolean,
 * sources: string, started_unix_ms: number }} EpisodeColumns one entry a step, but for numbers of the whole; `digests` has 16
 * digits a step; `buttons` and `untrusted` list the steps that a button on the screen or a program's event made
 */

const TENTHS = 10;
const FORMAT = "minihuman-game", VERSION = 1;

/** The name of a key as episodes keep it. @param {string} key of a KeyboardEvent */
export const nameKey = (key) => (key.length === 1 ? key.toLowerCase() : key);

/** An episode as it is played. */
export class EpisodeRecord {
  /** @type {EpisodeColumns} */ #columns;
  /** @type {Map<string, { step: number, pressed_ms: number }>} keys that are down */ #down = new Map();

  /** @param {World} world just reset @param {{ view: string, key_map: Record<string, string>, time_limit_ms?: number, now?: number }} trial */
  constructor(world, { view, key_map, time_limit_ms = 0, now = performance.now() }) {
    this.shown_ms = now; // of the first picture, by the page's clock
    this.#columns = {
      world: `minihuman/${world.name}`, options: world.options, seed: world.seed, view, key_map, keys: [], actions: [], rt_ms: [],
      held_ms: [], rewards: [], digests: "", buttons: [], untrusted: [], end: "left", time_limit_ms, playing_ms: 0, reward: 0,
      success: false, sources: world.sources, started_unix_ms: Math.round(Date.now()),
    };
  }

  get steps() { return this.#columns.actions.length; }

  /** Keep a step. @param {string} key @param {number} action @param {StepResult} step @param {number} stamp of the key's event
   * @param {{ button?: boolean, trusted?: boolean }} [how] */
  add(key, action, step, stamp, { button = false, trusted = true } = {}) {
    const columns = this.#columns, number = this.steps, rt_ms = this.#since(stamp);
    columns.keys.push(key);
    columns.actions.push(action);
    columns.rt_ms.push(rt_ms);
    columns.held_ms.push(null);
    columns.rewards.push(step.reward);
    columns.digests += step.digest;
    columns.reward += step.reward;
    if (button) columns.buttons.push(number);
    if (!trusted) columns.untrusted.push(number);
    if (step.terminated) columns.success = step.reward > 0;
    if (step.terminated || step.truncated) this.end(step.terminated ? "terminated" : "truncated", stamp);
    if (!button) this.#down.set(key, { step: number, pressed_ms: rt_ms });
  }

  /** A key came up. @param {string} key @param {number} stamp */
  release(key, stamp) {
    const press = this.#down.get(key);
    if (!press) return;
    this.#down.delete(key);
    this.#columns.held_ms[press.step] = Math.max(0, Math.round(this.#since(stamp) - press.pressed_ms));
  }

  /** Say how it ended. @param {EpisodeEnd} end @param {number} [now] */
  end(end, now = performance.now()) {
    this.#columns.end = end;
    this.#columns.playing_ms = this.#since(now);
  }

  /** @param {number} stamp */
  #since(stamp) { return Math.max(0, Math.round(TENTHS * (stamp - this.shown_ms)) / TENTHS); }

  /** @returns {EpisodeColumns} */
  get columns() { return structuredClone(this.#columns); }
}

/** The file of kept episodes, which `minihuman verify` and `minihuman import` take. @param {EpisodeColumns[]} episodes */
export const writeGame = (episodes) => JSON.stringify({ format: FORMAT, version: VERSION, episodes }, null, 1);
