// The network connection to the server: a socket that is opened again whenever it breaks, polling over HTTP where no
// socket gets through, and the latency.
// It knows how messages are framed and acknowledged, and nothing of what they mean to the screen.

import { collectBrowserFacts } from "./browser.js";
import { isServerReachable, PollingSocket } from "./polling.js";
import { IncomingStream } from "./stream.js";

/** @import { Pong, Refusal, ServerMessage, Texts, UnnumberedMessage, Welcome } from "./messages" */
/** @import { Outbox } from "./stream.js" */
/** @import { Picture } from "./pictures.js" */
/** @typedef {{ token: string, platform: Texts, made: boolean }} Link */
/** @typedef {WebSocket | PollingSocket} Transport */
/**
 * What the page does when something comes.
 * @typedef {object} Listener
 * @property {(m: Welcome) => void} welcome before anything is sent
 * @property {() => void} reset the server knows nothing of what it sent before
 * @property {(fresh: boolean) => void} resume everything is sent
 * @property {(m: ServerMessage) => void} message
 * @property {(picture: Picture) => void} picture
 * @property {(through: number) => void} acknowledged
 * @property {(text: string) => void} status
 * @property {(why: string, refusal: Refusal | null) => void} leave
 */

const VERSION = 9;
const MIN_RETRY_MS = 200;
const MAX_RETRY_MS = 3000;
const HTTP_AFTER_MS = 3000; // without a welcome
const SILENCE_MS = 20_000; // of a socket that has brought nothing: the line may be dead since the laptop slept
const LATE_MS = 120_000; // what was sent on a socket that was given up may come so much later
const RESIZE_PAUSE_MS = 500; // after the last change of size
const utf8 = new TextDecoder();

export class Connection {
  /** @type {Transport | null} the one that counts */ #socket = null;
  /** @type {PollingSocket | null} tried beside a socket that brings no welcome */ #beside = null;
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #httpTimer;
  #isReachable = true; // over HTTP, when that was tried last: the page itself came so
  #life = ""; // the server's numbering
  #gaveUpMs = -Infinity; // a socket that stayed silent
  #closeCode = 0; // of the last socket that was closed
  #retryMs = MIN_RETRY_MS;
  /** @type {Refusal | null} */ #refusal = null;
  #incoming = new IncomingStream((heard) => { if (this.welcomed) this.#send({ t: "heard", n: heard }); });
  welcomed = false;
  kernels = ""; // the digest of the worlds' rules that the page has
  finished = false; // do not come again
  taken = 0; // the session has all that is not later, though it may not be acknowledged: its server was another one
  /** @type {Texts} the server's words, in the study's language */
  words = { connecting: "…", reconnecting: "…", elsewhere: "…", title: "" };

  /** @param {Outbox} outbox @param {Link} link @param {Listener} listener */
  constructor(outbox, link, listener) {
    this.outbox = outbox;
    this.link = link;
    this.listener = listener;
    this.latency = new Latency(outbox, {
      isOpen: () => this.welcomed,
      send: (text) => this.#socket?.send(text),
      close: () => this.#socket?.close(),
    });
    outbox.transmit = (texts) => {
      if (!texts.length || !this.welcomed || this.#socket?.readyState !== WebSocket.OPEN) return;
      this.#socket.send([...this.latency.joinBatch(), ...texts].join("\n"));
    };
  }

  get wasWelcomed() { return this.#life !== ""; }

  /** What a person without a welcome tells the researchers: how sockets ended, 0 for not at all, and whether HTTP works. */
  get failureCode() { return `N-${this.#closeCode}-${this.#isReachable ? "H" : "X"}`; }

  /** @param {object} message */
  #send(message) { this.#socket?.send(JSON.stringify(message)); }

  open() {
    if (this.finished || this.welcomed) return; // over HTTP, meanwhile
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.#socket = new WebSocket(`${scheme}://${location.host}/socket?seat=${this.seat}`);
    this.#greetOn(this.#socket);
    this.#httpTimer ??= setTimeout(() => this.#considerHttp(), HTTP_AFTER_MS);
  }

  // Not while the server is away, nor at once when it is back: then a socket most likely gets through.
  async #considerHttp() {
    this.#httpTimer = undefined;
    if (this.welcomed || this.finished) return;
    this.#httpTimer = setTimeout(() => this.#considerHttp(), HTTP_AFTER_MS);
    if (this.#beside) return;
    const wasReachable = this.#isReachable;
    this.#isReachable = await isServerReachable();
    if (!wasReachable || !this.#isReachable || this.#beside || this.welcomed || this.finished) return;
    this.#beside = new PollingSocket(this.seat);
    this.#greetOn(this.#beside);
  }

  // The first that brings something counts; the other is given up, though a hello that it sent may come late.
  /** @param {Transport} transport */
  #prefer(transport) {
    const other = transport === this.#beside ? this.#socket : this.#beside;
    this.#socket = transport;
    this.#beside = null;
    if (other?.readyState === WebSocket.OPEN) this.#gaveUpMs = performance.now();
    other?.close();
  }

  /** @param {Transport} mine */
  #greetOn(mine) {
    const { state } = this.outbox;
    mine.binaryType = "arraybuffer";
    mine.onopen = () => {
      mine.send(JSON.stringify({
        t: "hello", version: VERSION, token: this.link.token, platform: this.link.platform, stream: state.stream,
        first: this.outbox.first, life: this.#life, heard: this.#incoming.received, segment: state.segment, last: state.last,
        facts: state.facts, kernels: this.kernels,
      }));
    };
    let isSilent = true;
    mine.onmessage = (/** @type {{ data: string | ArrayBuffer }} */ event) => {
      isSilent = false;
      if (mine !== this.#socket && mine !== this.#beside) return;
      if (this.#beside) this.#prefer(mine);
      this.#receive(event.data);
    };
    mine.onclose = (/** @type {{ code: number, reason: string }} */ event) => {
      if (mine === this.#beside) this.#beside = null;
      else if (mine === this.#socket) this.#retry(event.code, event.reason);
    };
    setTimeout(() => {
      if (mine === this.#beside && isSilent) {
        this.#beside = null;
        mine.close();
      }
      if (mine !== this.#socket || !isSilent || this.finished) return;
      this.#socket = null;
      this.#gaveUpMs = performance.now();
      mine.close();
      this.#retry(1006, "");
    }, SILENCE_MS);
  }

  // Which of several servers a seat is on: a proxy goes by it. It says nothing of the link.
  get seat() {
    const letters = [...JSON.stringify([this.link.token, this.link.platform])];
    const hash = (/** @type {number} */ sum, /** @type {string} */ letter) =>
      Math.imul(sum ^ (letter.codePointAt(0) ?? 0), 16777619) >>> 0;
    return this.outbox.state.pin ??= letters.reduce(hash, 2166136261).toString(16);
  }

  /** @param {number} code @param {string} reason */
  #retry(code, reason) {
    this.welcomed = false;
    this.#closeCode = code;
    if (code === 4001 && performance.now() - this.#gaveUpMs < LATE_MS) this.#gaveUpMs = -Infinity; // its hello came, late
    else if (code === 4001) this.#leave(this.words.elsewhere);
    else if (code === 4002) this.#reload(reason);
    else if (code >= 4003 && code < 4100) {
      if (this.#refusal) this.#leave(this.#refusal.words);
      else this.#reload(reason); // not a refusal of the person, but of what this page sent: an empty screen helps nobody
    }
    if (this.finished) return;
    setTimeout(() => { if (!this.welcomed && !this.finished) this.listener.status(this.words.reconnecting); }, 1500);
    setTimeout(() => this.open(), this.#retryMs);
    this.#retryMs = Math.min(MAX_RETRY_MS, this.#retryMs * 1.6);
  }

  // The server speaks otherwise since it was updated: what is kept goes to it from its own page. Only once in a while.
  /** @param {string} reason */
  #reload(reason) {
    if (performance.now() < 5000) { this.#leave(this.#refusal?.words || reason); return; }
    this.finished = true;
    location.reload();
  }

  /** @param {string} why */
  #leave(why) {
    this.finished = this.outbox.isStopped = true; // another tab of the link numbers its own
    this.listener.status("");
    this.listener.leave(why, this.#refusal);
    if (this.#refusal?.reason === "window") this.#awaitLargerWindow();
    if (this.#refusal?.reason === "gamepad") this.#awaitGamepad();
  }

  // Whoever makes the window larger is looked at again.
  #awaitLargerWindow() {
    /** @type {ReturnType<typeof setTimeout> | undefined} */ let timer;
    addEventListener("resize", () => {
      clearTimeout(timer);
      timer = setTimeout(() => location.reload(), RESIZE_PAUSE_MS);
    });
  }

  // Without loading the page again: the new one would not see the gamepad before its next press.
  #awaitGamepad() {
    addEventListener("gamepadconnected", async () => {
      this.#refusal = null;
      this.finished = this.outbox.isStopped = false;
      this.outbox.state.facts = await collectBrowserFacts();
      this.outbox.save();
      this.open();
    }, { once: true });
  }

  /** Say that the page is closed, or left for another one that may come back to it. @param {boolean} left */
  bidFarewell(left) { if (this.welcomed) this.#send({ t: "bye", left }); }

  /** End it for good, from this side. */
  close() {
    this.finished = true;
    this.welcomed = false;
    this.#socket?.close();
    this.#beside?.close();
  }

  /** @param {string | ArrayBuffer} data */
  #receive(data) {
    if (!(data instanceof ArrayBuffer)) { this.#take(JSON.parse(data)); return; }
    const view = new DataView(data);
    for (let at = 0; at < data.byteLength;) { // several as one
      const isPicture = view.getUint8(at), size = view.getUint32(at + 1, true), from = at + 5;
      at = from + size;
      if (!isPicture) { this.#take(JSON.parse(utf8.decode(new Uint8Array(data, from, size)))); continue; }
      if (!this.#incoming.take(view.getUint32(from, true))) continue;
      this.listener.picture({
        number: view.getUint32(from + 4, true), encoding: view.getUint8(from + 8), width: view.getUint16(from + 10, true),
        height: view.getUint16(from + 12, true), bytes: new Uint8Array(data.slice(from + 14, at)), tiles: [],
        bitmap: null, ready: null,
      });
    }
  }

  /** @param {UnnumberedMessage | { t: "n", n: number, m: ServerMessage }} message */
  #take(message) {
    if ("n" in message) {
      if (this.#incoming.take(message.n)) this.listener.message(message.m);
    } else if (message.t === "welcome") this.#welcome(message);
    else if (message.t === "pong") this.latency.receive(message);
    else if (message.t === "refused") {
      this.#refusal = message;
      this.outbox.state.facts = null; // whoever comes again has made the window larger, or sits elsewhere
      this.outbox.save();
    } else {
      this.outbox.acknowledge(message.through);
      this.listener.acknowledged(message.through);
    }
  }

  /** @param {Welcome} m */
  #welcome(m) {
    const fresh = this.#life === "";
    this.words = m.words;
    this.listener.welcome(m);
    if (m.token) this.link.token = m.token;
    if (m.token || this.link.made) history.replaceState(null, "", `#t=${this.link.token}`);
    this.outbox.setTime(m.segment, m.now, fresh, m.heard);
    this.taken = m.taken;
    this.outbox.catchUp(m.taken);
    if (!m.again) {
      this.#incoming.reset();
      this.#life = m.life;
      this.listener.reset();
    }
    for (const text of this.outbox.takeUnacknowledged(m.heard)) this.#socket?.send(text);
    this.welcomed = true;
    clearTimeout(this.#httpTimer);
    this.#httpTimer = undefined;
    this.#retryMs = MIN_RETRY_MS;
    this.listener.status("");
    this.listener.resume(fresh);
    this.latency.restart(m.sign_ms);
  }
}

const MAX_SILENCE_MS = 8000;
const REPORT_PERIOD_MS = 10000;
// Of the longest time in which the page sends nothing: a ping is due, and goes with messages; later it goes alone.
const DUE_SHARE = 0.55, ALONE_SHARE = 0.95;

/** Round-trip times: the fastest of the latest eight goes into the log now and then. */
class Latency {
  /** @type {{ sent: number, received: number, answered: number, back: number, rtt: number }[]} */ #samples = [];
  #pings = 0;
  #pingedMs = 0; // when the last one was sent that has no answer
  #reportedMs = -Infinity;
  #reports = 0;
  #signMs = 0;
  #nextMs = 0; // from then on it is time for another
  /** @type {ReturnType<typeof setTimeout> | undefined} */ #timer;
  least = Infinity; // ns, of all round trips on this socket
  /** @type {(message: import("./messages").PageMessage) => void} */ report = () => {};
  /** @type {() => boolean} whether something was typed since it was asked last, which no message tells of yet */ takeActed = () => false;

  /** @param {Outbox} outbox @param {{ isOpen(): boolean, send(text: string): void, close(): void }} socket */
  constructor(outbox, socket) {
    this.outbox = outbox;
    this.socket = socket;
  }

  /** @param {number} signMs the longest time in which the page sends nothing */
  restart(signMs) {
    this.#signMs = signMs;
    clearTimeout(this.#timer);
    this.#samples = [];
    this.least = Infinity;
    this.#reportedMs = -Infinity; // the new line may be quicker or slower
    this.#pings = this.#pingedMs = 0;
    this.#ping();
  }

  #ping() {
    if (!this.socket.isOpen()) return;
    if (this.#pingedMs && performance.now() - this.#pingedMs > MAX_SILENCE_MS) this.socket.close();
    else this.socket.send(this.#takePing());
  }

  #takePing() {
    const now = performance.now();
    this.#pingedMs ||= now;
    this.#nextMs = now + DUE_SHARE * this.#signMs;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#ping(), ++this.#pings < 4 ? 60 : ALONE_SHARE * this.#signMs);
    return JSON.stringify({ t: "ping", sent: this.outbox.now(), acted: this.takeActed() || undefined });
  }

  /** A ping for messages to take along, if it is time for one: its answer comes with their acknowledgement. */
  joinBatch() { return performance.now() < this.#nextMs ? [] : [this.#takePing()]; }

  /** @param {Pong} m */
  receive({ sent, received, answered }) {
    const back = this.outbox.now();
    this.#pingedMs = 0;
    const rtt = (back - sent) - (answered - received);
    this.least = Math.min(this.least, rtt);
    this.#samples = [...this.#samples.slice(-7), { sent, received, answered, back, rtt }];
    const count = this.#samples.length;
    const soon = (this.#reports === 0 && count >= 3) || (this.#reports === 1 && count === 8); // a start is no quiet time
    if (!soon && !(count >= 3 && performance.now() - this.#reportedMs > REPORT_PERIOD_MS)) return;
    this.#reports += 1;
    this.#reportedMs = performance.now();
    const { rtt: least, ...best } = this.#samples.reduce((a, b) => (a.rtt <= b.rtt ? a : b));
    this.report({ t: "link", ...best, latest: Math.max(0, rtt) });
  }
}
