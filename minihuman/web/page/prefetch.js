// Where the page is outside of episodes: the server's screen, or one that an input leads to and the server sent before.
// It touches no element and sends nothing; what the server says counts.

/** @import { PrefetchedScreen, ScreenMessage } from "./messages" */
/** @typedef {{ n: number, to: number }} Step an input that the server has not heard of, and where it led */

export class ScreenPrefetch {
  /** @type {Map<number, PrefetchedScreen>} by name */ screens = new Map();
  /** @type {Map<number, Map<string, number>>} name -> input -> name */ edges = new Map();
  /** @type {ScreenMessage | null} the server's screen */ serverScreen = null;
  /** @type {Step[]} */ trail = [];
  at = 0; // the name of what is shown
  shownAt = Infinity; // when it was there, ns
  lost = 0; // an input whose end is not known: nothing is known until the server has heard of it

  clear() { Object.assign(this, new ScreenPrefetch()); }

  get ahead() { return this.trail.length > 0; }

  /** @param {import("./messages").ScreenPrefetch} m */
  learn(m) {
    for (const screen of m.screens) this.screens.set(screen.name, screen);
    for (const [from, input, to] of m.edges) {
      const inputs = this.edges.get(from) ?? new Map();
      this.edges.set(from, inputs.set(input, to));
    }
  }

  /** @param {number} name @param {number} flip */
  sawAt(name, flip) {
    if (name === this.at) this.shownAt = flip;
  }

  /**
   * An input at a time went to the server as message n: the screen it leads to, or null where that is not known.
   * @param {number} n @param {string} input @param {number} at
   */
  took(n, input, at) {
    const known = this.lost || !(at >= this.shownAt) ? undefined : this.edges.get(this.at)?.get(input);
    const screen = known === undefined ? undefined : this.screens.get(known);
    if (!screen) {
      this.lost = n;
      return null;
    }
    this.trail.push({ n, to: screen.name });
    if (screen.name === this.at) return null;
    this.at = screen.name;
    this.shownAt = Infinity;
    return screen;
  }

  /** @param {number} n */
  unknown(n) { this.lost = n; }

  /** The server shows a screen: whether the page has to, or was there already. @param {ScreenMessage} m */
  tell(m) {
    const passed = this.#pass(m.through);
    this.serverScreen = m;
    return passed?.to === m.name && (this.ahead || this.at === m.name) ? false : this.#stay(m);
  }

  /** The server has heard of everything up to a message, and has said where that led. @param {number} through */
  acknowledge(through) {
    this.#pass(through);
    return this.serverScreen !== null && !this.ahead && this.at !== this.serverScreen.name && this.#stay(this.serverScreen);
  }

  /** @param {number} through */
  #pass(through) {
    const passed = this.trail.findLast((step) => step.n <= through);
    this.trail = this.trail.filter((step) => step.n > through);
    if (this.lost <= through) this.lost = 0;
    return passed;
  }

  /** @param {ScreenMessage} screen */
  #stay(screen) {
    this.trail = [];
    this.at = screen.name;
    this.shownAt = Infinity;
    return true;
  }
}
