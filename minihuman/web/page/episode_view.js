// An episode on a canvas, played by keys and buttons; what came of it is a promise. Knows no jsPsych and no frame.

import { EpisodeRecord, nameKey } from "./episode_record.js";

/** @import { EpisodeColumns } from "./episode_record.js" */
/** @import { World } from "./packed_world.js" */
/**
 * @typedef {{ seed: number, key_map: Record<string, string>, view?: "partial" | "full", width?: string, buttons?: boolean,
 * time_limit_ms?: number, on_step?: (columns: EpisodeColumns) => void }} EpisodeSettings `key_map`: `KeyboardEvent.key` to action
 */

const LABELS = /** @type {Record<string, string>} */ ({
  ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", " ": "space",
});

/** A canvas, the mission, and buttons where they are wanted. */
export class EpisodeView {
  /** @type {EpisodeRecord | null} */ #record = null;
  /** @type {AbortController | null} */ #listening = null;
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;
  /** @type {((columns: EpisodeColumns) => void) | null} */ #resolve = null;

  /** @param {HTMLElement} host @param {World} world @param {EpisodeSettings} settings */
  constructor(host, world, settings) {
    for (const [key, action] of Object.entries(settings.key_map)) {
      if (!world.actions.includes(action)) throw new Error(`key ${key} has action ${action}; ${world.name} has ${world.actions.join(", ")}`);
    }
    this.world = world;
    this.settings = settings;
    this.mission = host.appendChild(document.createElement("p"));
    this.mission.className = "minihuman-mission";
    this.canvas = host.appendChild(document.createElement("canvas"));
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", world.name);
    this.canvas.dataset.keys = JSON.stringify(settings.key_map);
    Object.assign(this.canvas.style, { width: settings.width ?? "min(90vw, 60vh)", imageRendering: world.isGrid ? "pixelated" : "auto" });
    if (settings.buttons) host.append(this.#buttons());
  }

  /** Play an episode; resolves with its columns when it is over. @param {EventTarget} [keys] what key events come to */
  async play(keys = document) {
    const { world, settings } = this, { seed, key_map, view = "partial", time_limit_ms = 0 } = settings;
    world.reset({ seed });
    this.mission.textContent = world.mission;
    await this.#draw();
    this.#record = new EpisodeRecord(world, { view, key_map, time_limit_ms });
    this.#listening = new AbortController();
    const { signal } = this.#listening;
    keys.addEventListener("keydown", (event) => this.#press(/** @type {KeyboardEvent} */ (event)), { signal });
    keys.addEventListener("keyup", (event) => this.#release(/** @type {KeyboardEvent} */ (event)), { signal });
    if (time_limit_ms > 0) this.#timer = setTimeout(() => this.leave("time_limit"), time_limit_ms);
    return new Promise((/** @type {(columns: EpisodeColumns) => void} */ resolve) => { this.#resolve = resolve; });
  }

  /** End an episode that is not over. @param {"time_limit" | "left"} [end] */
  leave(end = "left") {
    if (!this.#record || this.world.ended) return;
    this.#record.end(end);
    this.#finish();
  }

  /** What has been kept so far. */
  get columns() { return this.#record?.columns ?? null; }

  /** @param {KeyboardEvent} event */
  #press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = nameKey(event.key);
    if (!(key in this.settings.key_map)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.act(key, event.timeStamp, { trusted: event.isTrusted });
  }

  /** @param {KeyboardEvent} event */
  #release(event) { this.#record?.release(nameKey(event.key), event.timeStamp); }

  /** Do what a key does. @param {string} key @param {number} [stamp] @param {{ button?: boolean, trusted?: boolean }} [how] */
  act(key, stamp = performance.now(), how = {}) {
    const { world, settings } = this, record = this.#record, action = settings.key_map[key];
    if (!record || world.ended || action === undefined) return;
    record.add(key, world.actions.indexOf(action), world.step(action), stamp, how);
    void this.#draw();
    settings.on_step?.(record.columns);
    if (world.ended) setTimeout(() => this.#finish()); // the last picture first, and the last key's release if it comes at once
  }

  #finish() {
    clearTimeout(this.#timer);
    this.#listening?.abort();
    if (this.#record) this.#resolve?.(this.#record.columns);
    this.#resolve = null;
  }

  async #draw() { await this.world.draw(this.canvas, { view: this.settings.view ?? "partial" }); }

  #buttons() {
    const row = document.createElement("div");
    row.className = "minihuman-buttons";
    row.setAttribute("role", "group");
    for (const [key, action] of Object.entries(this.settings.key_map)) {
      const button = row.appendChild(document.createElement("button"));
      button.type = "button";
      button.textContent = `${action.replaceAll("_", " ")} (${LABELS[key] ?? key})`;
      button.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        this.act(key, event.timeStamp, { button: true, trusted: event.isTrusted });
      });
    }
    return row;
  }
}
