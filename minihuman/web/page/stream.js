// The two numbered streams between the page and the server, without a socket or an element of the document.

/** @import { BrowserFacts, PageMessage } from "./messages" */
/** @typedef {{ n: number, at: number, what: PageMessage }} Message */
/**
 * What a tab keeps over reloads, but for the stream's name.
 * @typedef {{ stream: string, next: number, segment: string, last: number, zero: number, facts: BrowserFacts | null, pin?: string,
 * token?: string }} StreamState
 */

export const UNTIMED = new Set(["shown", "link", "unheard", "altered"]); // what does not tell the session the time
const MAX_UNSENT = 64; // messages that wait for what follows
const MAX_UNREPORTED = 100; // the server looks less far ahead of a page that has more to report
const RESTART_NS = 2e9;
const OPEN_PATIENCE_MS = 5000; // after a crash a disk may be slow
const US = 1000; // the session's times are whole microseconds, which no browser's clock is finer than, in ns
/** @param {number} ms */
const ns = (ms) => Math.round(ms * 1e6);

/**
 * A message as it is sent. What comes with every key is a short array, times in us and those of events before the
 * message's own; `messages.py` reads both forms. @param {Message} message
 */
export function encodeMessage({ n, at, what }) {
  const values = shorten(at, what);
  if (!values || [at, ...values].some((value) => typeof value === "number" && !Number.isInteger(value))) {
    return JSON.stringify({ t: "n", n, at, what });
  }
  while ([undefined, "", false].includes(/** @type {any} */ (values[values.length - 1]))) values.pop();
  const [kind, ...rest] = values.map((value) => value ?? "");
  return JSON.stringify([kind, n, at / US, ...rest]);
}

/** @param {number} at @param {PageMessage} what @returns {(string | number | boolean | undefined)[] | null} */
function shorten(at, what) {
  const ago = (/** @type {number} */ t) => (at - t) / US;
  if (at % US) return null;
  if (what.t === "tick") return ["t", what.digest];
  if (what.t === "shown" && what.step !== undefined && what.screen === undefined && what.name === undefined) {
    return ["s", ago(what.flip), ago(what.submit), what.episode, what.step, what.node];
  }
  if (what.t !== "key" || what.trusted === false || what.cause) return null;
  return ["k", ago(what.stamp), what.key, what.down ? 1 : 0, what.digest, what.symbol, what.repeat];
}

/** What a tab keeps without a storage: nothing, once it is left. */
export class MemoryStorage {
  /** @type {Map<string, string>} */ #items = new Map();
  get length() { return this.#items.size; }
  /** @param {number} index */
  key(index) { return [...this.#items.keys()][index] ?? null; }
  /** @param {string} name */
  getItem(name) { return this.#items.get(name) ?? null; }
  /** @param {string} name @param {string} text */
  setItem(name, text) { this.#items.set(name, text); }
  /** @param {string} name */
  removeItem(name) { this.#items.delete(name); }
  clear() { this.#items.clear(); }
}

/** The tab's storage; where site data is blocked, even to ask for it is an error. @returns {Storage} */
export function openTabStorage() {
  try { return sessionStorage; } catch { return new MemoryStorage(); }
}

/** @param {number} size */
export function randomBytes(size) {
  return crypto.getRandomValues(new Uint8Array(size));
}

/**
 * A link's messages where they outlive the tab, in IndexedDB. It commits one transaction after the other: a tab that is
 * killed loses what came since the one that is under way began.
 */
export class MessageStore {
  /** @type {Map<number, string | null>} by number; null: delete it */ #changes = new Map();
  #isWriting = false;

  /** @param {IDBDatabase} database @param {string} seat */
  constructor(database, seat) {
    this.database = database;
    this.seat = seat;
  }

  /** @param {string} seat @returns {Promise<MessageStore | null>} null where the browser keeps nothing */
  static open(seat) {
    return new Promise((resolve) => {
      setTimeout(() => resolve(null), OPEN_PATIENCE_MS);
      try {
        const request = indexedDB.open("minihuman", 1);
        request.onupgradeneeded = () => request.result.createObjectStore("messages");
        request.onsuccess = () => resolve(new MessageStore(request.result, seat));
        request.onerror = () => resolve(null);
      } catch { resolve(null); }
    });
  }

  /** @returns {Promise<Map<number, string>>} what is kept, by number */
  load() {
    return new Promise((resolve) => {
      const store = this.database.transaction("messages").objectStore("messages");
      const mine = IDBKeyRange.bound([this.seat, 0], [this.seat, Infinity]);
      const keys = store.getAllKeys(mine), texts = store.getAll(mine);
      texts.onsuccess = () => resolve(new Map(keys.result.map((key, i) => [/** @type {any} */ (key)[1], texts.result[i]])));
      texts.onerror = () => resolve(new Map());
    });
  }

  /** @param {number} n 0 for the stream itself @param {string | null} text null: delete it */
  set(n, text) {
    this.#changes.set(n, text);
    if (this.#isWriting) return;
    this.#isWriting = true;
    queueMicrotask(() => this.#write()); // with all that is set in the same breath
  }

  #write() {
    this.#isWriting = true;
    const written = new Map(this.#changes);
    const transaction = this.database.transaction("messages", "readwrite"), store = transaction.objectStore("messages");
    for (const [n, text] of this.#changes) {
      if (text === null) store.delete([this.seat, n]);
      else store.put(text, [this.seat, n]);
    }
    this.#changes.clear();
    transaction.oncomplete = () => {
      this.#isWriting = false;
      if (this.#changes.size) this.#write();
    };
    transaction.onabort = () => { // the disk is full: once more with what comes next
      this.#isWriting = false;
      this.#changes = new Map([...written, ...this.#changes]);
    };
  }
}

/** What the page has sent, numbered and stamped with the session's time, until it is on the server's disk. */
export class Outbox {
  /** @type {Map<number, string>} */ #messages = new Map();
  /** @type {string[]} */ #unsent = [];
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;
  /** @type {number | null} performance time at the session's time 0, ns; null until it is known */ #zero = null;
  #discarded = false;
  isStopped = false; // nothing is added: the page was sent away
  /** @type {MessageStore | null} behind the tab's own storage */ #store = null;
  /** @type {(texts: string[]) => void} sends what it can; the rest stays here */ transmit = () => {};

  /** @param {Storage} storage @param {{ now(): number, timeOrigin: number }} clock */
  constructor(storage, clock) {
    this.storage = storage;
    this.clock = clock;
    const stream = Array.from(randomBytes(8), (b) => b.toString(16).padStart(2, "0")).join("");
    /** @type {StreamState} */ this.state = { stream, next: 1, segment: "", last: 0, zero: 0, facts: null };
    try { Object.assign(this.state, JSON.parse(storage.getItem("stream") ?? "{}")); } catch { /* nothing kept */ }
    this.state.stream = stream; // each page that is loaded has its own: a tab may be a copy of another that goes on
    for (let i = 0; i < storage.length; i++) {
      const name = storage.key(i) ?? "";
      if (name.startsWith("m")) this.#messages.set(Number(name.slice(1)), storage.getItem(name) ?? "");
    }
    if (this.state.segment) this.#zero = this.state.zero - ns(clock.timeOrigin);
  }

  /**
   * Keep messages in this store too, and go on with what a tab of the same link left that was killed or closed; one that
   * the browser restored has less than it had.
   * @param {MessageStore | null} store
   */
  async recover(store) {
    if (!store) return;
    const stored = await store.load(), head = /** @type {StreamState | null} */ (JSON.parse(stored.get(0) ?? "null"));
    this.#store = store;
    stored.delete(0);
    if (head && stored.size && ["", head.segment].includes(this.state.segment)) {
      if (!this.state.segment) Object.assign(this.state, head, { stream: this.state.stream }); // what time it is the server says
      this.state.last = Math.max(this.state.last, head.last);
      this.#merge(stored);
    }
    for (const n of stored.keys()) if (!this.#messages.has(n)) store.set(n, null);
    for (const [n, text] of this.#messages) store.set(n, text);
  }

  /**
   * Take over what another store has, too: either may be older than the other, or lack some. In the order of their times,
   * numbered without a gap, which the server would refuse. @param {Map<number, string>} stored
   */
  #merge(stored) {
    let n = Math.min(...stored.keys(), ...this.#messages.keys());
    const all = [...stored.values(), ...this.#messages.values()].map((text) => /** @type {Message} */ (JSON.parse(text)));
    for (const old of this.#messages.keys()) this.storage.removeItem(`m${old}`);
    this.#messages.clear();
    for (const message of [...new Map(all.map((m) => [m.at, m])).values()].sort((left, right) => left.at - right.at)) {
      const text = JSON.stringify({ ...message, n });
      this.#messages.set(n, text);
      this.#keep(`m${n++}`, text);
    }
    this.state.next = n;
    this.save();
  }

  get size() { return this.#messages.size; }
  get hasTime() { return this.#zero !== null; }
  get first() { return Math.min(this.state.next, ...this.#messages.keys()); }

  save() { this.#keep("stream", JSON.stringify(this.state)); }

  /** @returns {Record<string, string>} the session's names of keys; none before its first welcome */
  get keys() {
    try { return JSON.parse(this.storage.getItem("keys") ?? "{}"); } catch { return {}; }
  }

  set keys(names) { this.#keep("keys", JSON.stringify(names)); }

  /** @param {string} name @param {string} text */
  #keep(name, text) {
    if (this.#discarded) return;
    try { this.storage.setItem(name, text); } catch { /* it is full: what is sent stays in memory */ }
  }

  /** Forget everything and keep nothing from now on: what still happens before the page is left is nobody's. */
  discard() {
    this.clear();
    this.#discarded = true;
    this.#store = null;
    this.#zero = null;
    this.storage.clear();
  }

  /** The session's time, ns since the segment began, at a time of the clock. @param {number} ms */
  timeOf(ms) { return Math.max(0, US * Math.round((ns(ms) - (this.#zero ?? 0)) / US)); }
  now() { return this.timeOf(this.clock.now()); }

  /** The time of a message that is added now: later than the last one's. */
  nextTime() { return Math.max(US * Math.floor(this.state.last / US + 1), this.now()); }

  /**
   * Take over the server's time. A new segment has nothing of what was kept for the last one, so that the numbers
   * go on behind the last one received.
   * @param {string} segment @param {number} serverNow @param {boolean} fresh @param {number} received
   */
  setTime(segment, serverNow, fresh, received) {
    if (this.state.segment !== segment) {
      const keys = this.list().map((m) => m.what).filter((what) => what.t === "key").filter((what) => what.down);
      this.clear();
      this.#zero = ns(this.clock.now()) - serverNow;
      Object.assign(this.state, { segment, last: 0, next: received + 1 });
      this.#saveZero();
      if (keys.length) this.add({ t: "unheard", text: keys.map((k) => `${k.key} at ${k.stamp} ns`).join(", ").slice(0, 1900) });
    } else if (this.#zero === null || (fresh && Math.abs(this.now() - serverNow) > RESTART_NS)) {
      this.#zero = ns(this.clock.now()) - Math.max(serverNow, this.state.last + 1);
    }
    this.state.next = Math.max(this.state.next, received + 1); // the server may have what a killed tab did not keep
    this.#saveZero();
  }

  #saveZero() {
    this.state.zero = (this.#zero ?? 0) + ns(this.clock.timeOrigin);
    this.save();
  }

  /**
   * Number, keep and send a message; one that can wait goes with what follows in so many ms. @param {PageMessage} what
   * @param {number} at its time @returns {number} its number, or 0 while the session's time is unknown, or it is stopped
   */
  add(what, waitMs = 0, at = this.nextTime()) {
    if (this.#zero === null || this.isStopped) return 0;
    const n = this.state.next++;
    this.state.last = at;
    const message = { n, at, what }, text = JSON.stringify(message);
    this.#messages.set(n, text);
    this.#keep(`m${n}`, text);
    this.save();
    this.#store?.set(0, JSON.stringify({ ...this.state, facts: null }));
    this.#store?.set(n, text);
    this.#unsent.push(encodeMessage(message));
    if (waitMs && this.#unsent.length < MAX_UNSENT) this.#timer ??= setTimeout(() => this.#flush(), waitMs);
    else this.#flush();
    return n;
  }

  #flush() {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    const texts = this.#unsent;
    this.#unsent = [];
    this.transmit(texts);
  }

  /** The messages that a server lacks which has all up to `received`. @param {number} received */
  takeUnacknowledged(received) {
    this.#unsent = [];
    return this.list().filter(({ n }) => n > received).map(encodeMessage);
  }

  /** What happens from here on is later than what the session has, of this tab or of another. @param {number} taken */
  catchUp(taken) {
    if (this.#zero !== null && taken - this.now() > RESTART_NS) { // it slept, and its clock with it
      this.#zero = ns(this.clock.now()) - taken;
      this.#saveZero();
    }
    this.state.last = Math.max(this.state.last, taken);
    this.save();
  }

  #numbers() { return [...this.#messages.keys()].sort((a, b) => a - b); }

  /** @returns {Message[]} what is not acknowledged, in order */
  list() { return this.#numbers().map((n) => JSON.parse(this.#messages.get(n) ?? "")); }

  /** @param {number} through */
  hasAfter(through) { return [...this.#messages.keys()].some((n) => n > through); }

  /** @param {number} through */
  acknowledge(through) {
    for (const n of [...this.#messages.keys()]) {
      if (n > through) continue;
      this.#messages.delete(n);
      this.storage.removeItem(`m${n}`);
      this.#store?.set(n, null);
    }
    if (!this.#messages.size) this.#store?.set(0, null);
  }

  clear() { this.acknowledge(Infinity); }
}

/** The numbers that the server gives its messages; what was received is acknowledged now and then. */
export class IncomingStream {
  received = 0;
  #reported = 0;
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;

  /** @param {(received: number) => void} report */
  constructor(report) { this.report = report; }

  reset() { this.received = this.#reported = 0; }

  /** Whether a message is the next one; any other came before, or on another socket. @param {number} n */
  take(n) {
    if (n !== this.received + 1) return false;
    this.received = n;
    if (n >= this.#reported + MAX_UNREPORTED) this.#send();
    else this.#timer ??= setTimeout(() => this.#send(), 1000);
    return true;
  }

  #send() {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    this.#reported = this.received;
    this.report(this.received);
  }
}
