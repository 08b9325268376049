// Where a record goes: a file that the participant keeps, or an address that it is posted to as it grows. Nothing goes
// anywhere before the consent; `Saver` sees to it.

/** @import { Archive, RecordHead } from "./archive.js" */
/** @typedef {{ format: string, version: number, first: number, messages: string[] } & Partial<RecordHead>} RecordPart */
/**
 * @typedef {object} Collector
 * @property {boolean} isWhole whether it takes the record at the end, not as it grows
 * @property {number} period_ms between parts, and the time to wait after a part that did not arrive
 * @property {() => Promise<Record<string, string>>} [open] waits until it can save; the parameters of the participant's link
 * @property {(part: RecordPart) => Promise<void>} save
 * @property {(end: string) => void} [finish] what follows the last part
 */

const FORMAT = "minihuman-site", VERSION = 1;
const PERIOD_MS = 5_000, DATAPIPE_PERIOD_MS = 60_000; // DataPipe makes a file of each part
const LAST_TRIES = 8, RETRY_MS = 1_500;
const PART_CHARACTERS = 1_000_000; // of a part's messages: requests have limits, DataPipe's of 32 MB
// Its API's page and source (of October 2025, read 29 November 2026): a POST of experimentID, filename and data; each file has a name of its
// own, and counts as a session.
const DATAPIPE = "https://pipe.jspsych.org/api/data/";

/** The collector answered, and does not want the record: its quota is full, or it takes no data any more. */
class RefusedError extends Error {}

/**
 * The record from a message on. @param {Archive} archive @param {number} first
 * @param {number} characters of messages at most, but for a message that is longer @returns {RecordPart}
 */
export function makePart(archive, first, characters = Infinity) {
  const { facts, ...head } = /** @type {RecordHead} */ (archive.head);
  let last = first, length = 0;
  while (last < archive.texts.length && (last === first || length + archive.texts[last].length <= characters)) length += archive.texts[last++].length;
  const complete = head.complete && last === archive.texts.length;
  return { format: FORMAT, version: VERSION, ...head, ...(first ? {} : { facts }), complete, first, messages: archive.texts.slice(first, last) };
}

/** A file for the participant to send. @type {Collector} */
const download = {
  isWhole: true,
  period_ms: PERIOD_MS,
  async save(part) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([JSON.stringify(part)], { type: "application/json" }));
    link.download = `${part.study}-${part.id}.json`;
    link.click();
  },
};

/** @param {string} address @param {string} body */
async function post(address, body) {
  const response = await fetch(address, { method: "POST", headers: { "content-type": "application/json" }, body });
  if (response.ok) return;
  const isFinal = response.status >= 400 && response.status < 500 && response.status !== 408 && response.status !== 429;
  throw new (isFinal ? RefusedError : Error)(`${address} answered ${response.status}`);
}

/** Posts each part as JSON. @param {string} address @returns {Collector} */
const makePoster = (address) => ({ isWhole: false, period_ms: PERIOD_MS, save: (part) => post(address, JSON.stringify(part)) });

/** Files of an experiment of DataPipe's. @param {string} experimentID @param {string} [address] @returns {Collector} */
export const makeDataPipe = (experimentID, address = DATAPIPE) => ({
  isWhole: false,
  period_ms: DATAPIPE_PERIOD_MS,
  save(part) { // a part whose answer was lost may be there already, and its name is taken
    const filename = `${part.id}-${part.first}-${Date.now()}.json`;
    return post(address, JSON.stringify({ experimentID, filename, data: JSON.stringify(part) }));
  },
});

/**
 * Result data of a component of JATOS, a part a line: by `jatos.js`, which JATOS serves beside the page, and whose functions
 * work from `onLoad` on (its reference, read 29 November 2026). The page shows the end itself, with the completion code.
 * @type {Collector}
 */
const jatosCollector = {
  isWhole: false,
  period_ms: PERIOD_MS,
  open: () => new Promise((resolve) => { jatos.onLoad(() => resolve(jatos.urlQueryParameters)); }),
  async save(part) {
    try {
      await jatos.appendResultData(`${JSON.stringify(part)}\n`);
    } catch (error) { throw new RefusedError(String(error)); } // it has tried again itself
  },
  finish(end) {
    if (end === "declined") jatos.abortStudy(end, false);
    else jatos.endStudy(end === "complete", end, false);
  },
};

/** @param {string} name as `minihuman site --collector` took it @returns {Collector} */
export function chooseCollector(name) {
  if (name === "download") return download;
  if (name === "jatos") return jatosCollector;
  return name.startsWith("datapipe:") ? makeDataPipe(name.slice("datapipe:".length)) : makePoster(name);
}

/** Sends what the archive has and the collector has not. */
export class Saver {
  #isBusy = false;
  #isAsked = false; // while it is busy
  /** @type {ReturnType<typeof setInterval> | undefined} from the consent to the end */ #timer;

  /** @param {Archive} archive @param {Collector} collector */
  constructor(archive, collector) {
    this.archive = archive;
    this.collector = collector;
  }

  /** From the consent on. */
  start() {
    if (!this.collector.isWhole) this.#timer ??= setInterval(() => this.#save().catch(() => {}), this.collector.period_ms);
  }

  /** Send what there is now, after the consent: an episode or a part is over, and is not to wait for the period. */
  saveSoon() {
    if (this.#isBusy) this.#isAsked = true;
    else if (this.#timer !== undefined) this.#save().catch(() => {});
  }

  async #save() {
    const { archive } = this;
    const first = this.collector.isWhole ? 0 : archive.head?.sent ?? 0;
    if (this.#isBusy || (first === archive.texts.length && !this.collector.isWhole)) return;
    this.#isBusy = true;
    try {
      const part = makePart(archive, first, this.collector.isWhole ? Infinity : PART_CHARACTERS);
      await this.collector.save(part);
      await archive.change({ sent: first + part.messages.length });
    } finally { this.#isBusy = false; }
    if (this.#isAsked) {
      this.#isAsked = false;
      this.saveSoon();
    }
  }

  get #isDone() { return this.collector.isWhole || this.archive.head?.sent === this.archive.texts.length; }

  /** Send the rest; false where the collector does not answer, so that it is tried when the page is opened again. */
  async finish() {
    clearInterval(this.#timer);
    this.#timer = undefined;
    let isRefused = false;
    for (let tries = 0; tries < LAST_TRIES; tries++) {
      try {
        do await this.#save(); while (!this.#isDone && !this.#isBusy);
        if (this.#isDone) return true;
      } catch (error) { isRefused = error instanceof RefusedError; } // or the network is away
      await new Promise((resolve) => { setTimeout(resolve, RETRY_MS); });
    }
    if (isRefused) await download.save(makePart(this.archive, 0)); // the participant has it, at least
    return isRefused;
  }
}
