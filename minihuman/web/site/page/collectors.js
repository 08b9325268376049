// Where a record goes: a file that the participant keeps, or an address that it is posted to as it grows. Nothing goes
// anywhere before the consent; `Saver` sees to it.

/** @import { Archive, RecordHead } from "./archive.js" */
/** @typedef {{ format: string, version: number, first: number, messages: string[] } & RecordHead} RecordPart */
/** @typedef {{ isWhole: boolean, save(part: RecordPart): Promise<void>, finish?(): Promise<void> }} Collector `isWhole`: it takes the record at the end, not as it grows */

const FORMAT = "minihuman-site", VERSION = 1;
const PERIOD_MS = 5_000, LAST_TRIES = 8, RETRY_MS = 1_500;

/** @param {Archive} archive @param {number} first @returns {RecordPart} */
export function makePart(archive, first) {
  return { format: FORMAT, version: VERSION, ... /** @type {RecordHead} */ (archive.head), first, messages: archive.texts.slice(first) };
}

/** A file for the participant to send. @type {Collector} */
const download = {
  isWhole: true,
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
const address = (address) => ({ isWhole: false, save: (part) => post(address, JSON.stringify(part)) });

/** @param {string} name as `minihuman site --collector` took it @returns {Collector} */
export function chooseCollector(name) {
  return name === "download" ? download : address(name);
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
    if (!this.collector.isWhole) this.#timer ??= setInterval(() => this.#save().catch(() => {}), PERIOD_MS);
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
