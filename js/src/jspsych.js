// A jsPsych 8 plugin: an episode a trial. Its data are columns, from which `minihuman import` plays it again.

import { EpisodeView } from "./episode_view.js";
import { World } from "./packed_world.js";

/** @import { EpisodeColumns } from "./episode_record.js" */
/** @typedef {any} JsPsych of jsPsych 8, which this package does not bring */

/** jsPsych's numbers of parameter types, so that its script is not needed here: `ParameterType` of 8.x. */
const BOOL = 0, STRING = 1, INT = 2, FLOAT = 3, KEYS = 6, OBJECT = 12;

const info = /** @type {const} */ ({
  name: "minihuman-episode",
  version: "0.1.0",
  parameters: {
    /** a world that is in the pack */ world: { type: STRING, default: undefined },
    /** of the layout */ seed: { type: INT, default: undefined },
    /** the folder that `minihuman pack` wrote; the package's own by default */ from: { type: STRING, default: null },
    /** another step limit of a grid world; 0: its own */ max_steps: { type: INT, default: 0 },
    /** "partial" or "full" */ view: { type: STRING, default: "partial" },
    /** the actions that get a key */ actions: { type: STRING, array: true, default: ["left", "right", "forward"] },
    /** the keys that they are drawn from, where there is no key map */ keys: { type: KEYS, default: ["d", "f", "j", "k"] },
    /** key to action; null draws one, "carry" takes that of the trial before */ key_map: { type: OBJECT, default: null },
    /** buttons for fingers */ buttons: { type: BOOL, default: false },
    /** the trial ends after so long, milliseconds; 0: never */ time_limit: { type: FLOAT, default: 0 },
    /** shows the outcome and waits for so long, milliseconds */ feedback_duration: { type: FLOAT, default: 500 },
    /** the feedback by outcome */ feedback: { type: OBJECT, default: { success: "✓", failure: "✗", timeout: "…" } },
  },
  data: {
    world: { type: STRING }, options: { type: OBJECT }, seed: { type: INT }, view: { type: STRING }, key_map: { type: OBJECT },
    keys: { type: STRING, array: true }, actions: { type: INT, array: true }, rt_ms: { type: FLOAT, array: true },
    held_ms: { type: FLOAT, array: true }, rewards: { type: FLOAT, array: true }, digests: { type: STRING },
    buttons: { type: INT, array: true }, untrusted: { type: INT, array: true }, end: { type: STRING },
    time_limit_ms: { type: FLOAT }, playing_ms: { type: FLOAT }, reward: { type: FLOAT }, success: { type: BOOL },
    sources: { type: STRING }, started_unix_ms: { type: FLOAT },
  },
  citations: { apa: "", bibtex: "" },
});

/** @type {WeakMap<JsPsych, Record<string, string>>} the key map of the latest trial */
const carried = new WeakMap();

/** @type {WeakMap<JsPsych, number>} when the latest simulated trial ended, though no time passed */
const simulatedEnds = new WeakMap();

/** An episode in a world. */
export default class MinihumanEpisodePlugin {
  static info = info;

  /** @param {JsPsych} jsPsych */
  constructor(jsPsych) { this.jsPsych = jsPsych; }

  /** @param {HTMLElement} element @param {any} trial @param {() => void} [on_load] */
  async trial(element, trial, on_load) {
    const world = await this.#makeWorld(trial);
    element.replaceChildren();
    const view = new EpisodeView(element, world, this.#settings(trial));
    const over = view.play();
    on_load?.();
    const columns = await over;
    await this.#showFeedback(view, trial, columns);
    world.close();
    element.replaceChildren();
    this.jsPsych.finishTrial(columns);
  }

  /** @param {any} trial */
  #makeWorld({ world, from, max_steps }) {
    return World.make(world, from === null ? { max_steps } : { from, max_steps });
  }

  /** @param {any} trial */
  #settings({ seed, view, key_map, actions, keys, buttons, time_limit }) {
    const last = key_map === "carry" ? carried.get(this.jsPsych) : undefined;
    const map = last ?? (key_map !== null && typeof key_map === "object" ? key_map : this.#drawKeys(keys, actions));
    carried.set(this.jsPsych, map);
    return { seed, view, key_map: map, buttons, time_limit_ms: time_limit };
  }

  /** @param {string[]} keys @param {string[]} actions @returns {Record<string, string>} */
  #drawKeys(keys, actions) {
    if (keys.length < actions.length) throw new Error(`${actions.length} actions need as many keys, not ${keys.length}`);
    const drawn = this.jsPsych.randomization.sampleWithoutReplacement(keys, actions.length);
    return Object.fromEntries(actions.map((action, number) => [drawn[number], action]));
  }

  /** @param {EpisodeView} view @param {any} trial @param {EpisodeColumns} columns */
  #showFeedback(view, { feedback, feedback_duration }, { end, success }) {
    view.mission.textContent = feedback[success ? "success" : end === "terminated" ? "failure" : "timeout"] ?? "";
    return new Promise((/** @type {(value: void) => void} */ resolve) => {
      this.jsPsych.pluginAPI.setTimeout(resolve, feedback_duration);
    });
  }

  /**
   * jsPsych's simulation: random keys; "data-only" plays without a picture, "visual" presses keys in the trial.
   * @param {any} trial @param {"data-only" | "visual"} mode @param {any} options @param {() => void} on_load
   */
  async simulate(trial, mode, options, on_load) {
    return mode === "visual" ? this.#simulateVisual(trial, on_load) : this.#simulateData(trial, options, on_load);
  }

  /** @param {any} trial @param {any} options @param {() => void} on_load */
  async #simulateData(trial, options, on_load) {
    const { EpisodeRecord } = await import("./episode_record.js");
    const world = await this.#makeWorld(trial), { seed, view, key_map } = this.#settings(trial);
    world.reset({ seed });
    on_load();
    const record = new EpisodeRecord(world, { view, key_map, now: 0 });
    for (let stamp = 0; !world.ended;) {
      const key = this.#drawKey(key_map);
      stamp += this.jsPsych.randomization.sampleExGaussian(300, 60, 1 / 150, true);
      record.add(key, world.actions.indexOf(/** @type {string} */ (key_map[key])), world.step(/** @type {string} */ (key_map[key])), stamp, { trusted: false });
      record.release(key, stamp + 80);
    }
    world.close();
    const columns = record.columns, started_unix_ms = Math.max(columns.started_unix_ms, simulatedEnds.get(this.jsPsych) ?? 0);
    simulatedEnds.set(this.jsPsych, Math.ceil(started_unix_ms + columns.playing_ms));
    this.jsPsych.finishTrial({ ...columns, started_unix_ms, ...options?.data });
  }

  /** @param {any} trial @param {() => void} on_load */
  #simulateVisual(trial, on_load) {
    const element = this.jsPsych.getDisplayElement();
    const running = this.trial(element, trial, () => {
      on_load();
      const map = /** @type {Record<string, string>} */ (carried.get(this.jsPsych));
      const press = () => {
        if (!element.querySelector("canvas")) return;
        const key = this.#drawKey(map);
        document.dispatchEvent(new KeyboardEvent("keydown", { key }));
        document.dispatchEvent(new KeyboardEvent("keyup", { key }));
        this.jsPsych.pluginAPI.setTimeout(press, 50);
      };
      press();
    });
    return running;
  }

  /** @param {Record<string, string>} map @returns {string} */
  #drawKey(map) { return this.jsPsych.randomization.sampleWithoutReplacement(Object.keys(map), 1)[0]; }
}
