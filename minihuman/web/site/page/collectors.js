// Where a record goes: a file that the participant keeps, or an address that it is posted to as it grows. Nothing goes
// anywhere before the consent; `Saver` sees to it.

/** @import { Archive, RecordHead } from "./archive.js" */
/** @typedef {{ format: string, version: number, first: number, messages: string[] } & RecordHead} RecordPart */
/**
 * @typedef {object} Collector
 * @property {boolean} isWhole whether it takes the record at the end, not as it grows
 * @property {number} period_ms between parts, and the time to wait after a part that did not arrive
 * @property {(part: RecordPart) => Promise<void>} save
 * @property {() => void} [finish] what follows the last part
 */

const FORMAT = "minihuman-site", VERSION = 1;
const PERIOD_MS = 5_000, DATAPIPE_PERIOD_MS = 60_000; // DataPipe makes a file of each part
const LAST_TRIES = 8, RETRY_MS = 1_500;
// by its guide, read 29 November 2026: a POST of experimentID, filename and data, each file under a name of its own
const DATAPIPE = "https://pipe.jspsych.org/api/data/";

/** @param {Archive} archive @param {number} first @returns {RecordPart} */
export function makePart(archive, first) {
  return { format: FORMAT, version: VERSION, ... /** @type {RecordHead} */ (archive.head), first, messages: archive.texts.slice(first) };
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
  if (!response.ok) throw new Error(`${address} answered ${response.status}`);
}

/** Posts each part as JSON. @param {string} address @returns {Collector} */
const makePoster = (address) => ({ isWhole: false, period_ms: PERIOD_MS, save: (part) => post(address, JSON.stringify(part)) });

/** Files of an experiment of DataPipe's. @param {string} experimentID @param {string} [address] @returns {Collector} */
export function makeDataPipe(experimentID, address = DATAPIPE) {
  let tries = 0;
  return { isWhole: false, period_ms: DATAPIPE_PERIOD_MS, save: (part) => {
    tries += 1; // a part whose answer was lost may be there already, and its name is taken
    const filename = `${part.id}-${part.first}-${tries}.json`;
    return post(address, JSON.stringify({ experimentID, filename, data: JSON.stringify(part) }));
  } };
}

/** Result data of a component of JATOS, a part a line: by `jatos.js`, which JATOS serves beside the page. @type {Collector} */
const jatos = {
  isWhole: false,
  period_ms: PERIOD_MS,
  save: async (part) => { await /** @type {any} */ (globalThis).jatos.appendResultData(`${JSON.stringify(part)}\n`); },
  finish: () => { /** @type {any} */ (globalThis).jatos.endStudy(); },
};

/** @param {string} name as `minihuman site --collector` took it @returns {Collector} */
export function chooseCollector(name) {
  if (name === "download") return download;
  if (name === "jatos") return jatos;
  return name.startsWith("datapipe:") ? makeDataPipe(name.slice("datapipe:".length)) : makePoster(name);
}

/** Sends what the archive has and the collector has not. */
export class Saver {
  #isBusy = false;
  /** @type {ReturnType<typeof setInterval> | undefined} */ #timer;

  /** @param {Archive} archive @param {Collector} collector */
  constructor(archive, collector) {
    this.archive = archive;
    this.collector = collector;
  }

  /** From the consent on. */
  start() {
    if (!this.collector.isWhole) this.#timer ??= setInterval(() => this.#save().catch(() => {}), this.collector.period_ms);
  }

  async #save() {
    const { archive } = this;
    const first = this.collector.isWhole ? 0 : archive.head?.sent ?? 0;
    if (this.#isBusy || (first === archive.texts.length && !this.collector.isWhole)) return;
    this.#isBusy = true;
    try {
      const part = makePart(archive, first);
      await this.collector.save(part);
      await archive.change({ sent: first + part.messages.length });
    } finally { this.#isBusy = false; }
  }

  /** Send the rest; false where the collector does not answer, so that it is tried when the page is opened again. */
  async finish() {
    clearInterval(this.#timer);
    for (let tries = 0; tries < LAST_TRIES; tries++) {
      try {
        await this.#save();
        if (this.collector.isWhole || this.archive.head?.sent === this.archive.texts.length) return true;
      } catch { /* the network is away */ }
      await new Promise((resolve) => { setTimeout(resolve, RETRY_MS); });
    }
    return false;
  }
}
