// <minihuman-world world="MiniGrid-FourRooms-v0" seed="3">: an episode in plain HTML, or in a frame of another tool's page.
// When it is over it fires `minihuman-episode`, whose `detail` has the columns, and tells the page around its frame.

import { EpisodeView } from "./episode_view.js";
import { World } from "./packed_world.js";

const ARROWS = "ArrowLeft=left,ArrowRight=right,ArrowUp=forward,space=toggle,p=pickup,d=drop,ArrowLeft=turn_left,ArrowRight=turn_right,ArrowUp=move_forward";

/** @param {string} text "f=left,j=right" @param {string[]} actions @returns {Record<string, string>} */
export function readKeyMap(text, actions) {
  const pairs = text.split(",").map((pair) => pair.split("=").map((word) => word.trim()));
  return Object.fromEntries(pairs.filter(([, action]) => actions.includes(action ?? ""))
    .map(([key, action]) => [key === "space" ? " " : key, action]));
}

/** Attributes: world, seed, from, max-steps, view, keys ("f=left,j=right"), buttons, time-limit (ms), parent-origin. */
export class MinihumanWorldElement extends HTMLElement {
  /** @type {EpisodeView | null} */ #view = null;
  #generation = 0;

  connectedCallback() { void this.play(); }

  disconnectedCallback() {
    this.#generation += 1;
    this.#view?.leave();
    this.#view?.world.close();
    this.#view = null;
  }

  /** Play an episode, and another where it is called again. */
  async play() {
    const generation = this.#generation += 1;
    const from = this.getAttribute("from"), max_steps = Number(this.getAttribute("max-steps") ?? 0);
    const world = await World.make(this.getAttribute("world") ?? "", from ? { from, max_steps } : { max_steps });
    if (generation !== this.#generation) return world.close();
    this.#view?.world.close();
    this.replaceChildren();
    this.#view = new EpisodeView(this, world, {
      seed: Number(this.getAttribute("seed") ?? world.seeds[0]), view: this.getAttribute("view") === "full" ? "full" : "partial",
      key_map: readKeyMap(this.getAttribute("keys") ?? ARROWS, world.actions), buttons: this.hasAttribute("buttons"),
      time_limit_ms: Number(this.getAttribute("time-limit") ?? 0), width: this.getAttribute("width") ?? "min(90vw, 60vh)",
    });
    const detail = await this.#view.play();
    this.dispatchEvent(new CustomEvent("minihuman-episode", { detail, bubbles: true }));
    const origin = this.getAttribute("parent-origin"); // without one nothing is told: a page around may be anybody's
    if (origin && globalThis.parent !== globalThis.window) globalThis.parent.postMessage({ type: "minihuman-episode", episode: detail }, origin);
  }
}

if (!customElements.get("minihuman-world")) customElements.define("minihuman-world", MinihumanWorldElement);
