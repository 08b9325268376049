// A study that is open on the page: its document as the server last sent it, and edits, one after the other. The file is
// the truth: nothing is kept here that the file does not have.
/** @import { Document, Edit, Mistake } from "./messages" */
import { RefusedError, editStudy, readForm, readStudy, stepHistory } from "./requests.js";

const LOOK_MS = 1000; // between looks at the file, which may be edited beside the page

/** @typedef {(string | number)[]} FieldPath */
/** @typedef {{ message: string, edits: Edit[], isConflict: boolean }} Failure an edit that was not made */

/** @param {FieldPath} path */
export const formatPath = (path) =>
  path.map((step, place) => (typeof step === "number" ? `[${step}]` : place ? `.${step}` : step)).join("");

/** @param {any} tree @param {FieldPath} path @returns {any} */
export const readAt = (tree, path) => path.reduce((branch, step) => branch?.[step], tree);

/** @param {FieldPath} path @param {FieldPath} above */
export const isBelow = (path, above) => above.every((step, place) => path[place] === step);

export class OpenStudy {
  /** @param {string} key @param {() => void} changed is called after every change of what is shown */
  constructor(key, changed) {
    this.key = key;
    this.changed = changed;
    /** @type {Document | null} */
    this.document = null;
    /** @type {Failure | null} */
    this.failure = null;
    this.unsaved = 0; // edits that the server has not answered
    this.wasEditedElsewhere = false;
    this._queue = Promise.resolve();
    this._timer = 0;
    /** @type {Map<string, Promise<import("./messages").FieldForm>>} */
    this._forms = new Map();
  }

  async open() {
    this._show(await readStudy(this.key));
    const look = async () => {
      if (!document.hidden && !this.unsaved) await this._look();
      this._timer = setTimeout(look, LOOK_MS);
    };
    this._timer = setTimeout(look, LOOK_MS);
  }

  /** Read the file again, such as after what it may run has changed. */
  async reload() {
    this._show(await readStudy(this.key));
  }

  close() {
    clearTimeout(this._timer);
    this.changed = () => {};
  }

  async _look() {
    const version = this.document?.version ?? "";
    const answer = await readStudy(this.key, version).catch(() => null);
    if (!answer || this.unsaved || answer.version === this.document?.version) return;
    this.wasEditedElsewhere = true;
    this._show(answer);
  }

  /** @param {Document | null} newest */
  _show(newest) {
    if (newest) this.document = newest;
    this.changed();
  }

  /**
   * Change the file: all edits or none. They are made after those before them, on the version that these left.
   * @param {Edit[]} edits @returns {Promise<boolean>} whether they were made
   */
  edit(edits) {
    return this._enqueue((version) => editStudy(this.key, version, edits), edits);
  }

  /**
   * Change the file by edits that depend on it, once those before them have been made.
   * @param {() => Edit[]} build @returns {Promise<boolean>} whether they were made
   */
  editNext(build) {
    return this._queue.then(() => this.edit(build()));
  }

  /** @param {"undo" | "redo"} way */
  step(way) {
    return this._enqueue((version) => stepHistory(this.key, version, way), []);
  }

  /** @param {(version: string) => Promise<Document>} send @param {Edit[]} edits @returns {Promise<boolean>} */
  _enqueue(send, edits) {
    this.unsaved += 1;
    this.failure = null;
    this.wasEditedElsewhere = false;
    this.changed();
    const turn = this._queue.then(() => this._send(send, edits));
    this._queue = turn.then(() => {});
    return turn;
  }

  /** @param {(version: string) => Promise<Document>} send @param {Edit[]} edits */
  async _send(send, edits) {
    try {
      const answer = await send(this.document?.version ?? "");
      this.unsaved -= 1;
      this._show(answer);
      return true;
    } catch (error) {
      this.unsaved -= 1;
      const newest = error instanceof RefusedError ? error.refusal.document ?? null : null;
      const message = error instanceof RefusedError ? error.message : "The desk does not answer; is it still running?";
      this.failure = { message, edits, isConflict: newest !== null };
      this._show(newest);
      return false;
    }
  }

  /** Make the edits again that a conflict prevented, on the file as it is now. */
  retry() {
    const edits = this.failure?.edits ?? [];
    this.dismiss();
    return edits.length ? this.edit(edits) : Promise.resolve(false);
  }

  dismiss() {
    this.failure = null;
    this.wasEditedElsewhere = false;
    this.changed();
  }

  /** @param {FieldPath} path @returns {any} */
  read(path) {
    return readAt(this.document?.tree, path);
  }

  /** @param {string} table @param {string} kind */
  form(table, kind = "") {
    const name = `${table} ${kind}`;
    const form = this._forms.get(name) ?? readForm(table, kind);
    this._forms.set(name, form);
    form.catch(() => this._forms.delete(name));
    return form;
  }

  /** @param {FieldPath} path @returns {Mistake[]} the mistakes at a field or below it */
  mistakesAt(path) {
    return (this.document?.mistakes ?? []).filter((mistake) => mistake.path.length > 0 && isBelow(mistake.path, path));
  }

  /** @param {FieldPath} path @returns {string} why a field must not change; "" if it may */
  restrictionAt(path) {
    const fields = this.document?.restrictions.fields ?? [];
    return fields.find((field) => isBelow(path, field.path))?.reason ?? "";
  }
}
