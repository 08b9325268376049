// The whole page in Node, before a document that draws nothing, on a virtual clock: acts come from a script, and what
// the page sends goes to the machine behind it, which a test plays in Python over this program's pipes.

import fs from "node:fs";
import readline from "node:readline";
import zlib from "node:zlib";

import { MemoryStorage } from "../../../minihuman/web/page/stream.js";

const PAGE = new URL("../../../minihuman/web/page/", import.meta.url);
const FRAME_MS = 1000 / 60;
const TASK_MS = 0.05; // until a task that was posted runs
const REPEAT_DELAY_MS = 480, REPEAT_PERIOD_MS = 31; // of the system's, which is not the page's
const MODIFIERS = { ControlLeft: "ctrlKey", AltLeft: "altKey", ShiftLeft: "shiftKey" };
const FACTS = {
  browser: "Node", browser_version: "20", platform: "", isolated: true, timer_step_ms: 0.005, refresh_hz: 60, rtt_ms: 1,
  pixel_ratio: 1, window_px: "1000 x 800", display_px: "1000 x 800", touch: false, mouse: true, gamepad: false, language: "en",
  utc_offset_min: 0,
};

/** What happens, in order of time; what is posted for the same time stays in order. */
class EventQueue {
  #tasks = [];
  #posted = 0;
  now = 0;

  /** @param {number} ms @param {() => void} run @returns {number} a name to cancel it by */
  post(ms, run) {
    const task = { ms: Math.max(ms, this.now), number: ++this.#posted, run };
    let at = this.#tasks.length;
    while (at && this.#tasks[at - 1].ms > task.ms) at--;
    this.#tasks.splice(at, 0, task);
    return task.number;
  }

  /** @param {number} number */
  cancel(number) { this.#tasks = this.#tasks.filter((task) => task.number !== number); }

  /** @param {number} untilMs */
  async run(untilMs) {
    while (this.#tasks.length && this.#tasks[0].ms <= untilMs) {
      const { ms, run } = this.#tasks.shift();
      this.now = ms;
      await run();
      await settle();
    }
    this.now = untilMs;
  }
}

/** Let promises that wait for nothing but each other resolve. */
const settle = () => new Promise((resolve) => { setImmediate(resolve); });

class ClassList extends Set {
  remove(...names) { for (const name of names) this.delete(name); }
  contains(name) { return this.has(name); }
  toggle(name, force = !this.has(name)) { return force ? this.add(name) : this.delete(name); }
}

class SilentElement {
  dataset = {};
  style = {};
  classList = new ClassList();
  children = [];
  isConnected = true;
  clientWidth = 1000;
  textContent = "";
  append(...children) { this.children.push(...children); }
  replaceChildren(...children) { this.children = children; }
  replaceWith() {}
  remove() {}
  setAttribute(name, text) { if (name.startsWith("data-")) this.dataset[name.slice(5)] = text; }
  addEventListener() {}
  focus() {}
  querySelector() { return null; }
  closest() { return null; }
  setSelectionRange() {}
  getContext() { return { drawImage() {}, putImageData() {} }; }
}

/** The browser around one page, and the person before it. */
class VirtualBrowser {
  queue = new EventQueue();
  /** @type {Map<string, ((event: object) => void)[]>} */ listeners = new Map();
  hasFocus = true;
  /** @type {Map<string, number | undefined>} keys that are down, with the timer of the system's repetition */ down = new Map();
  #lastArrivals = { up: 0, down: 0 };

  /** @param {(request: object) => Promise<any>} ask @param {{ up_ms: number, down_ms: number, jitter: number[] }} line */
  constructor(ask, line) {
    this.ask = ask;
    this.line = line;
    this.jitters = 0;
    this.install();
  }

  install() {
    const { queue } = this, browser = this;
    const define = (name, value) => Object.defineProperty(globalThis, name, { value, configurable: true, writable: true });
    const storage = new MemoryStorage();
    storage.setItem("stream", JSON.stringify({ facts: FACTS }));
    define("performance", { now: () => queue.now, timeOrigin: 0 });
    define("setTimeout", (run, ms = 0) => queue.post(queue.now + Math.max(ms, TASK_MS), run));
    define("clearTimeout", (number) => queue.cancel(number));
    define("requestAnimationFrame", (run) =>
      queue.post((Math.floor(queue.now / FRAME_MS) + 1) * FRAME_MS, () => run(queue.now)));
    define("MessageChannel", class {
      port1 = { onmessage: () => {} };
      port2 = { postMessage: () => queue.post(queue.now + TASK_MS, () => this.port1.onmessage()) };
    });
    define("addEventListener", (type, listener) => {
      browser.listeners.set(type, [...browser.listeners.get(type) ?? [], listener]);
    });
    define("document", {
      hidden: false, title: "", activeElement: null, documentElement: new SilentElement(),
      hasFocus: () => browser.hasFocus, addEventListener() {},
      getElementById: () => new SilentElement(), createElement: () => new SilentElement(), querySelector: () => null,
    });
    for (const name of ["Element", "HTMLElement", "HTMLCanvasElement", "HTMLInputElement", "Node"]) define(name, SilentElement);
    define("sessionStorage", storage);
    define("location", { hash: "#t=virtual", search: "", protocol: "http:", host: "virtual", reload() {} });
    define("history", { replaceState() {} });
    define("navigator", { getGamepads: () => [], userAgent: "", language: "en", maxTouchPoints: 0 });
    define("matchMedia", () => ({ matches: false, addEventListener: () => {} }));
    define("devicePixelRatio", 1);
    define("MutationObserver", class { observe() {} });
    define("getComputedStyle", () => ({ fontSize: "16px" }));
    define("innerWidth", 1000);
    define("innerHeight", 800);
    define("ImageData", class { constructor(_, width, height) { Object.assign(this, { width, height }); } });
    define("createImageBitmap", async ({ width, height }) => ({ width, height }));
    define("WebSocket", class extends VirtualSocket { constructor() { super(browser); } });
  }

  /** When something sent now arrives; nothing overtakes. @param {"up" | "down"} way */
  arrival(way) {
    const jitter = this.line.jitter[this.jitters++ % this.line.jitter.length];
    const ms = Math.max(this.#lastArrivals[way], this.queue.now + this.line[`${way}_ms`] + jitter);
    return this.#lastArrivals[way] = ms;
  }

  /** @param {string} type @param {object} [fields] */
  emit(type, fields = {}) {
    const event = { type, isTrusted: true, timeStamp: this.queue.now, target: null, preventDefault() {}, ...fields };
    for (const listener of this.listeners.get(type) ?? []) listener(event);
  }

  /** @param {string} type @param {[code: string, key: string]} named @param {boolean} isRepeat */
  #emitKey(type, [code, key], isRepeat) {
    const modifiers = Object.fromEntries(Object.entries(MODIFIERS).map(([name, field]) => [field, this.down.has(name)]));
    this.emit(type, { code, key, repeat: isRepeat, isComposing: false, keyCode: 0, getModifierState: () => false, ...modifiers });
  }

  /** A person does something. @param {string} what @param {[code: string, key: string]} named */
  act(what, named) {
    const code = named?.[0];
    if (what === "focus" || what === "blur") {
      const hasFocus = what === "focus";
      if (hasFocus === this.hasFocus) return;
      this.hasFocus = hasFocus;
      this.emit(what);
    } else if (what === "down" && !this.down.has(code)) {
      for (const timer of this.down.values()) this.queue.cancel(timer); // the system repeats the latest alone
      this.down.set(code, undefined);
      if (this.hasFocus) this.#emitKey("keydown", named, false);
      if (!(code in MODIFIERS)) this.#repeat(named, REPEAT_DELAY_MS);
    } else if (what === "up" && this.down.has(code)) {
      this.queue.cancel(this.down.get(code));
      this.down.delete(code);
      if (this.hasFocus) this.#emitKey("keyup", named, false);
    }
  }

  /** @param {[code: string, key: string]} named @param {number} ms */
  #repeat(named, ms) {
    this.down.set(named[0], this.queue.post(this.queue.now + ms, () => {
      if (this.hasFocus) this.#emitKey("keydown", named, true);
      this.#repeat(named, REPEAT_PERIOD_MS);
    }));
  }
}

/** A socket to the machine in Python, over a line with a latency. */
class VirtualSocket {
  static OPEN = 1;
  readyState = 0;

  /** @param {VirtualBrowser} browser */
  constructor(browser) {
    this.browser = browser;
    browser.queue.post(browser.queue.now + 1, () => { this.readyState = 1; this.onopen(); });
  }

  /** @param {string} text */
  send(text) {
    const { browser } = this;
    browser.queue.post(browser.arrival("up"), async () => {
      for (const batch of await browser.ask({ at_ms: browser.queue.now, text })) {
        const content = typeof batch === "string" ? batch : Uint8Array.from(Buffer.from(batch.bytes, "base64")).buffer;
        browser.queue.post(browser.arrival("down"), () => this.onmessage({ data: content }));
      }
    });
  }

  close() {}
}

/** Answers that take no time, in place of the browser's own, which take some that no virtual clock knows. */
function installInstantAnswers() {
  const compiled = new Map();
  const { instantiate } = WebAssembly;
  globalThis.fetch = async (address) => {
    const content = fs.readFileSync(new URL(address.replace("/static/", "./"), PAGE));
    return { json: async () => JSON.parse(content), arrayBuffer: async () => content };
  };
  WebAssembly.instantiate = async (code, imports) => {
    if (code instanceof WebAssembly.Module) return instantiate(code, imports);
    const module = compiled.get(code.length) ?? new WebAssembly.Module(code);
    compiled.set(code.length, module);
    return { module, instance: new WebAssembly.Instance(module, imports) };
  };
  globalThis.Blob = class {
    constructor([bytes]) { this.bytes = bytes; }
    stream() { return { pipeThrough: () => zlib.inflateSync(this.bytes) }; }
  };
  globalThis.Response = class {
    constructor(bytes) { this.bytes = bytes; }
    async arrayBuffer() { return Uint8Array.from(this.bytes).buffer; }
  };
  globalThis.DecompressionStream = class {};
}

installInstantAnswers();
const lines = readline.createInterface({ input: process.stdin })[Symbol.asyncIterator]();
const read = async () => JSON.parse((await lines.next()).value ?? "null");
const write = (/** @type {object} */ message) => process.stdout.write(`${JSON.stringify(message)}\n`);
const ask = (/** @type {object} */ request) => { write(request); return read(); };

for (let run = 0, script = await read(); script; run++, script = await read()) {
  const browser = new VirtualBrowser(ask, script.line);
  for (const [ms, what, named] of script.acts) browser.queue.post(ms, () => browser.act(what, named));
  await import(new URL(`page.js?${run}`, PAGE).href);
  await browser.queue.run(script.until_ms);
  const { step, kind, playing, unsafe } = globalThis.minihuman.state;
  write({ page: { step, kind, playing, unsafe } });
}
process.exit(0);
