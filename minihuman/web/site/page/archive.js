// The record of a session in this browser, in IndexedDB: every numbered message, in order, and what it is a record of.

const DATABASE = "minihuman-site", VERSION = 1;

/**
 * @typedef {{ id: string, study: string, build: string, slot: number, started_unix_ms: number, facts: any, complete: boolean,
 * sent: number }} RecordHead `sent`: the messages that the collector has
 */

/** @template T @param {IDBRequest<T>} request @returns {Promise<T>} */
const finish = (request) => new Promise((resolve, reject) => {
  request.onsuccess = () => resolve(request.result);
  request.onerror = () => reject(request.error);
});

/** The sessions of one study in this browser; in memory where it keeps nothing. */
export class Archive {
  /** @type {RecordHead | null} */ head = null;
  /** @type {string[]} the messages as they were sent */ texts = [];

  /** @param {IDBDatabase | null} database @param {string} study */
  constructor(database, study) {
    this.database = database;
    this.study = study;
  }

  /** @param {string} study @returns {Promise<Archive>} with the latest session of the study, if there is one */
  static async open(study) {
    let database = null;
    try {
      const request = indexedDB.open(DATABASE, VERSION);
      request.onupgradeneeded = () => {
        request.result.createObjectStore("heads");
        request.result.createObjectStore("messages");
      };
      database = await finish(request);
    } catch { /* a private window */ }
    const archive = new Archive(database, study);
    await archive.#load();
    return archive;
  }

  async #load() {
    if (!this.database) return;
    const transaction = this.database.transaction(["heads", "messages"]);
    this.head = await finish(transaction.objectStore("heads").get(this.study)) ?? null;
    if (this.head) this.texts = await finish(transaction.objectStore("messages").getAll(this.#range(this.head.id)));
  }

  /** @param {string} id */
  #range(id) { return IDBKeyRange.bound([id, 0], [id, Infinity]); }

  /** Begin a record. @param {RecordHead} head */
  async begin(head) {
    this.head = head;
    this.texts = [];
    await this.#write((heads) => heads.put(head, this.study));
  }

  /** Add messages; they are kept when this is done. @param {string[]} texts */
  async add(texts) {
    const first = this.texts.length, id = this.head?.id ?? "";
    this.texts.push(...texts);
    await this.#write((_, messages) => texts.forEach((text, place) => messages.put(text, [id, first + place])));
  }

  /** Change what the record says of itself. @param {Partial<RecordHead>} changes */
  async change(changes) {
    if (!this.head) return;
    Object.assign(this.head, changes);
    const { head } = this;
    await this.#write((heads) => heads.put(head, this.study));
  }

  /** Forget what was done, but not that somebody was here. */
  async erase() {
    const id = this.head?.id ?? "";
    this.texts = [];
    await this.#write((_, messages) => messages.delete(this.#range(id)));
  }

  /** @param {(heads: IDBObjectStore, messages: IDBObjectStore) => void} change @returns {Promise<void>} */
  #write(change) {
    const { database } = this;
    if (!database) return Promise.resolve();
    return new Promise((resolve) => {
      const transaction = database.transaction(["heads", "messages"], "readwrite");
      change(transaction.objectStore("heads"), transaction.objectStore("messages"));
      transaction.oncomplete = () => resolve();
      transaction.onabort = () => resolve(); // the disk is full: memory has it
    });
  }
}
