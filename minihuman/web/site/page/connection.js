// In the place of the connection to a server: the session is followed here, kept in this browser, and saved by a
// collector. To the rest of the page it is a server that always answers at once.

import { Archive } from "./archive.js";
import { Saver, chooseCollector } from "./collectors.js";
import { EpisodeComputer } from "./computed.js";
import { Follower } from "./follower.js";

/** @import { ServerMessage, Texts } from "./messages" */
/** @import { Message, Outbox } from "./stream.js" */
/** @import { PageRunModule } from "./page_tools" */
/** @import { SlotScript } from "./follower.js" */
/** @typedef {{ token: string, platform: Texts, made: boolean }} Link */
/** @typedef {{ version: number, study: string, build: string, collector: string, slots: number, sources: string, words: any }} Site */

const STUDY = new URL("../study/", import.meta.url);

/** @param {string} name @returns {Promise<any>} */
async function read(name) {
  const response = await fetch(new URL(name, STUDY));
  if (!response.ok) throw new Error(`${name} answered ${response.status}`);
  return response.json();
}

export class Connection {
  /** @type {Follower | null} */ #follower = null;
  /** @type {Archive | null} */ #archive = null;
  /** @type {Saver | null} */ #saver = null;
  /** @type {Promise<void>} */ #kept = Promise.resolve();
  #isEnding = false;
  welcomed = false;
  kernels = "";
  finished = false;
  taken = 0;
  /** @type {any} */ words = { connecting: "…", reconnecting: "…", elsewhere: "…", title: "" };
  latency = { least: 0, report: () => {} };
  seat = "site";

  /** @param {Outbox} outbox @param {Link} link @param {any} listener as `connection.js` of a served page has it */
  constructor(outbox, link, listener) {
    this.outbox = outbox;
    this.link = link;
    this.listener = listener;
    outbox.transmit = (texts) => {
      if (texts.length && this.welcomed) queueMicrotask(() => this.#take(texts));
    };
  }

  async open() {
    /** @type {Site} */ const site = await read("site.json");
    this.words = site.words;
    const archive = this.#archive = await Archive.open(site.study);
    const collector = chooseCollector(site.collector), parameters = { ...this.link.platform, ...await collector.open?.() };
    this.#saver = new Saver(archive, collector);
    if (archive.head?.complete) {
      if (archive.texts.length) await this.#saver.finish(); // what did not arrive, or a file that was lost
      return this.#leave(site.words.finished);
    }
    if (archive.head && archive.head.build !== site.build) return this.#leave(site.words.closed);
    const computer = this.kernels === site.sources ? await EpisodeComputer.load() : null;
    if (!computer) return this.#leave(site.words.browser.replace("{browsers}", "Chrome, Edge, Firefox, Safari"));
    const slot = archive.head?.slot ?? this.#chooseSlot(site.slots, parameters.slot);
    /** @type {SlotScript} */ const script = await read(`slot-${slot}.json`);
    const names = new Set(Object.values(script.episodes).flatMap(({ arrays }) => arrays));
    const arrays = await Promise.all([...names].map((name) => read(`arrays/${name}.json`)));
    for (const content of arrays) computer.learnArrays(content);
    const modules = await loadModules(script);
    if (!archive.head) await archive.begin(this.#describe(site, slot));
    this.#welcome(script, computer, arrays, modules);
  }

  /** By the link, or drawn. @param {number} slots @param {string | undefined} number as the link has it */
  #chooseSlot(slots, number) {
    const asked = Number(number ?? NaN);
    if (Number.isInteger(asked) && asked >= 1 && asked <= slots) return asked - 1;
    return crypto.getRandomValues(new Uint32Array(1))[0] % slots;
  }

  /** @param {Site} site @param {number} slot */
  #describe(site, slot) {
    const id = Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("");
    const { facts } = this.outbox.state;
    return { id, study: site.study, build: site.build, slot, started_unix_ms: Date.now(), facts, complete: false, sent: 0 };
  }

  /**
   * @param {SlotScript} script @param {EpisodeComputer} computer @param {any[]} arrays
   * @param {Map<string, PageRunModule>} modules
   */
  #welcome(script, computer, arrays, modules) {
    const archive = /** @type {Archive} */ (this.#archive), head = /** @type {NonNullable<Archive["head"]>} */ (archive.head);
    const follower = this.#follower = new Follower(script, computer, {
      message: (m) => this.#tell(m),
      picture: (picture) => this.listener.picture(picture),
      agreed: () => this.#saver?.start(),
      settled: () => { void this.#kept.then(() => this.#saver?.saveSoon()); },
    }, modules);
    const past = archive.texts.map(readMessage);
    follower.restore(past);
    this.taken = past.at(-1)?.at ?? 0;
    const received = past.at(-1)?.n ?? 0, now = Math.max((Date.now() - head.started_unix_ms) * 1e6, this.taken + 1000);
    this.words = script.words;
    this.listener.welcome({ keys: script.keys, touch: script.touch, words: script.words, gamepad: false, sounds: script.sounds });
    this.outbox.setTime(head.id, now, true, received);
    this.outbox.catchUp(this.taken);
    this.outbox.acknowledge(received);
    this.listener.reset();
    for (const content of arrays) this.listener.message(content);
    for (const picture of script.pictures) this.listener.picture(unpackPicture(picture));
    this.welcomed = true;
    this.listener.status("");
    follower.repeat();
    if (follower.agreed) this.#saver?.start();
    const unheard = this.outbox.takeUnacknowledged(received);
    if (unheard.length) this.#take(unheard);
    this.listener.resume(true);
  }

  // What is followed is kept first; what is kept is acknowledged.
  /** @param {string[]} texts */
  #take(texts) {
    const archive = this.#archive, follower = this.#follower;
    if (!archive || !follower || this.#isEnding) return;
    const messages = texts.map(readMessage), through = messages.at(-1)?.n ?? 0;
    this.#kept = Promise.all([this.#kept, archive.add(texts)]).then(() => {
      this.outbox.acknowledge(through);
      this.listener.acknowledged(through);
    });
    for (const message of messages) follower.receive(message);
  }

  // The end is told when the record is where it belongs.
  /** @param {ServerMessage} m */
  #tell(m) {
    if (m.t !== "over") return this.listener.message(m);
    this.#isEnding = true;
    void this.#end(m);
  }

  /** @param {Extract<ServerMessage, { t: "over" }>} m */
  async #end(m) {
    const archive = /** @type {Archive} */ (this.#archive), saver = /** @type {Saver} */ (this.#saver);
    await this.#kept;
    await archive.change({ complete: true });
    if (m.end === "declined") await archive.erase();
    else while (!await saver.finish()) this.listener.status(this.words.reconnecting); // "saved" is said when it is
    this.listener.status("");
    this.listener.message(m);
    saver.collector.finish?.(m.end);
  }

  /** @param {string} why */
  #leave(why) {
    this.finished = this.outbox.isStopped = true;
    this.listener.status("");
    this.listener.leave(why, null);
  }

  /** @param {boolean} left */
  bidFarewell(left) { void left; }

  close() {
    this.finished = true;
    this.welcomed = false;
  }
}

/** The modules of what the page runs by itself. @param {SlotScript} script @returns {Promise<Map<string, PageRunModule>>} */
async function loadModules({ nodes }) {
  const addresses = [...new Set(nodes.flatMap(({ run }) => (run ? [run.module] : [])))];
  return new Map(await Promise.all(addresses.map(async (address) => /** @type {[string, PageRunModule]} */ ([address, await import(address)]))));
}

/** @param {any} picture */
function unpackPicture({ data, ...picture }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  return { ...picture, bytes, tiles: [], bitmap: null, ready: null };
}

/**
 * A message as the outbox sends it, or as the archive keeps it. @param {string} text @returns {Message}
 */
export function readMessage(text) {
  const message = JSON.parse(text);
  if (!Array.isArray(message)) return { n: message.n, at: message.at, what: message.what };
  const [kind, n, us, ...rest] = message, at = us * 1000, ago = (/** @type {number} */ by) => at - by * 1000;
  if (kind === "t") return { n, at, what: { t: "tick", digest: rest[0] ?? "" } };
  if (kind === "s") return { n, at, what: { t: "shown", flip: ago(rest[0]), submit: ago(rest[1]), episode: rest[2], step: rest[3], node: rest[4] ?? -1 } };
  const [stamp, key, down, digest = "", symbol = "", repeat = false] = rest;
  return { n, at, what: { t: "key", key, down: down === 1, stamp: ago(stamp), digest, symbol, repeat: repeat === true } };
}

