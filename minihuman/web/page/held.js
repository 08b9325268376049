// What is held while time makes the steps: keys that are down, presses and the mouse's motion since the last step, and
// axes. Together they make the action of a step, by the session's own rule (minihuman/experiment/machine/running_episode.py).

import { roundHalfEven } from "./world.js";

/** @import { EpisodeRules, PageMessage, VectorRules } from "./messages" */
/** @typedef {number | number[]} HeldAction by number, or a vector */

const MOUSE_AXES = ["mouse_x", "mouse_y"];

/** @param {VectorRules} rules @param {number[]} vector */
const clip = ({ low, high }, vector) => vector.map((value, at) => Math.min(Math.max(value, low[at]), high[at]));

/** The vector of several actions, the latest last. @param {VectorRules} rules @param {number[]} numbers */
export function combineElements(rules, numbers) {
  const vector = [...rules.rest];
  for (const number of numbers) {
    if (number === 0) continue;
    const [component, value] = rules.elements[number - 1];
    vector[component] += value - (rules.adds[component] ? rules.rest : vector)[component];
  }
  return clip(rules, vector);
}

/** @param {VectorRules} rules @param {number[]} vector @param {number} component @param {number} share -1 to 1 */
function moveComponent(rules, vector, component, share) {
  const end = (share > 0 ? rules.high : rules.low)[component];
  const reach = Number.isFinite(end) ? Math.abs(end - rules.rest[component]) : 1;
  const moved = [...vector];
  moved[component] += rules.whole[component] ? roundHalfEven(share * reach) : share * reach;
  return clip(rules, moved);
}

export class HeldInputs {
  /** @type {Set<string>} the latest last */ #down = new Set();
  /** @type {Set<string>} since the last step, the latest last */ #pressed = new Set();
  /** @type {Map<string, number>} where they are; of the mouse, pixels since the last step */ #axes = new Map();

  /** What was sent. @param {PageMessage} what */
  take(what) {
    if (what.t === "key") {
      if (!what.down) this.#down.delete(what.key);
      else if (!what.cause || what.cause === "finger") this.#down.add(what.key);
    } else if (what.t === "focus" && !what.focused) this.#down.clear();
    else if (what.t === "axis") this.#axes.set(what.axis, what.value);
    else if (what.t === "motion") this.#axes.set(what.axis, (this.#axes.get(what.axis) ?? 0) + what.pixels);
  }

  /** A key that does an action was pressed. @param {string} key */
  press(key) {
    this.#pressed.delete(key);
    this.#pressed.add(key);
  }

  /** A step has it, or none will. */
  drop() {
    this.#pressed.clear();
    for (const axis of MOUSE_AXES) this.#axes.delete(axis);
  }

  /** What the server has. @param {import("./messages").HeldInputs} inputs */
  restore({ down, pressed, axes }) {
    this.#down = new Set(down);
    this.#pressed = new Set(pressed);
    this.#axes = new Map(Object.entries(axes));
  }

  /** The action of a step that is made now; null for none. @param {EpisodeRules} rules @returns {HeldAction | null} */
  combine(rules) {
    const { actions, combines, vectors, noop } = rules;
    const held = [...this.#down].filter((key) => key in actions && !this.#pressed.has(key));
    const numbers = [...held, ...this.#pressed].map((key) => actions[key]);
    const shares = this.#listShares(combines?.axes ?? {});
    if (!numbers.length && !shares.size) return noop;
    if (!vectors) {
      const chord = combines?.chords.find(([keys]) => keys.length === new Set(numbers).size && keys.every((n) => numbers.includes(n)));
      return chord ? chord[1] : numbers[numbers.length - 1];
    }
    let vector = combineElements(vectors, numbers);
    for (const [component, share] of shares) vector = moveComponent(vectors, vector, component, share);
    return vector;
  }

  /** How far axes move each component. @param {Record<string, [component: number, scale: number]>} bound */
  #listShares(bound) {
    /** @type {Map<number, number>} */ const shares = new Map();
    for (const [axis, [component, scale]] of Object.entries(bound)) {
      let share = (this.#axes.get(axis) ?? 0) * scale;
      if (MOUSE_AXES.includes(axis)) share = Math.max(-1, Math.min(1, share)); // a quick turn of the hand is no more than a step
      if (share) shares.set(component, (shares.get(component) ?? 0) + share);
    }
    return shares;
  }
}
