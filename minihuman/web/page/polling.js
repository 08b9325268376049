// What speaks with the server where no web socket gets through: long polling over HTTP, with the face of a WebSocket.
// One request at a time brings texts, another waits for what the server sends; both are numbered, so that one that
// failed is repeated without harm.

import { randomBytes } from "./stream.js";

const MAX_TEXTS = 400, MAX_BODY_CHARACTERS = 20_000; // of a request, beyond its first text
const MAX_KEEPALIVE_CHARACTERS = 15_000; // browsers let a closed page send 64 KiB
const ANSWER_MS = 35_000; // the server answers after 20 s at the latest
const RETRIES = 3, RETRY_MS = 300;
const BROKEN = 1006; // as of a socket that ended without a code

/** @param {number} ms */
const wait = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });

/** A transport like a WebSocket that opens at once; whether the server is there shows with the first text. */
export class PollingSocket {
  readyState = 0;
  binaryType = "arraybuffer";
  /** @type {() => void} */ onopen = () => {};
  /** @type {(event: { data: string | ArrayBuffer }) => void} */ onmessage = () => {};
  /** @type {(event: { code: number, reason: string }) => void} */ onclose = () => {};
  #line = Array.from(randomBytes(16), (byte) => byte.toString(16).padStart(2, "0")).join("");
  /** @type {string[]} */ #texts = [];
  #brought = 0; // requests of each kind
  #fetched = 0;
  #isBringing = false;
  /** @type {Set<AbortController>} of requests that are not answered */ #aborts = new Set();

  /** @param {string} seat which of several servers it is on: a proxy goes by it, as with a socket */
  constructor(seat) {
    this.seat = seat;
    setTimeout(() => {
      if (this.readyState !== 0) return;
      this.readyState = 1;
      this.onopen();
    }, 0);
  }

  /** @param {string} text */
  send(text) {
    if (this.readyState !== 1) return;
    this.#texts.push(text);
    if (!this.#isBringing) void this.#bring();
  }

  /** End it from this side; the server sees that nothing is fetched any more. */
  close() { this.#end(BROKEN, ""); }

  /** @param {number} code @param {string} reason */
  #end(code, reason) {
    if (this.readyState === 3) return;
    this.readyState = 3;
    for (const abort of this.#aborts) abort.abort();
    setTimeout(() => this.onclose({ code, reason }), 0); // later, as a socket says it
  }

  async #bring() {
    this.#isBringing = true;
    while (this.#texts.length && this.readyState === 1) {
      const answer = await this.#post({ n: ++this.#brought, texts: this.#takeTexts() });
      if (answer && this.#brought === 1) void this.#fetch(); // now there is a line
    }
    this.#isBringing = false;
  }

  #takeTexts() {
    let characters = 0;
    let count = 1;
    while (count < Math.min(MAX_TEXTS, this.#texts.length)) {
      characters += JSON.stringify(this.#texts[count]).length;
      if (characters > MAX_BODY_CHARACTERS) break;
      count += 1;
    }
    return this.#texts.splice(0, count);
  }

  async #fetch() {
    while (this.readyState === 1) {
      const data = await this.#post({ n: ++this.#fetched });
      if (data?.byteLength && this.readyState === 1) this.onmessage({ data });
    }
  }

  /**
   * Send a request until it is answered in full. @param {{ n: number, texts?: string[] }} request
   * @returns {Promise<ArrayBuffer | null>} the answer; null: the line has ended
   */
  async #post(request) {
    const body = JSON.stringify({ line: this.#line, ...request });
    for (let tries = 0; tries <= RETRIES && this.readyState === 1; tries++) {
      if (tries) await wait(RETRY_MS);
      const abort = new AbortController(), timer = setTimeout(() => abort.abort(), ANSWER_MS);
      this.#aborts.add(abort);
      try {
        const response = await fetch(`/socket?seat=${this.seat}`, {
          method: "POST", headers: { "content-type": "application/json" }, body, cache: "no-store",
          keepalive: body.length < MAX_KEEPALIVE_CHARACTERS && request.texts !== undefined,
          signal: abort.signal,
        });
        if (response.status === 410) {
          const { code, reason } = await response.json();
          this.#end(code, reason ?? "");
          return null;
        }
        const data = await response.arrayBuffer();
        if (response.ok) return data;
        if (response.status < 500) break;
      } catch { // the network, or the answer was cut: once more
      } finally {
        clearTimeout(timer);
        this.#aborts.delete(abort);
      }
    }
    this.#end(BROKEN, "");
    return null;
  }
}

/** Whether the server answers over HTTP now. */
export async function isServerReachable() {
  try {
    return (await fetch("/favicon.ico", { cache: "no-store" })).ok;
  } catch { return false; }
}
