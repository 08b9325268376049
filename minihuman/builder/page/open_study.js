// A study that is open on the page: its document as the server last sent it, and edits, one after the other. The file is
// the truth: nothing is kept here that the file does not have, or gets by the edits that are on their way.
/** @import { Document, Edit, Mistake } from "./messages" */
import { isBelow, readAt, showEdits } from "./edits.js";
import { RefusedError, editStudy, readForm, readStudy, stepHistory } from "./requests.js";

const LOOK_MS = 1000; // between looks at the file, which may be edited beside the page

/** @typedef {(string | number)[]} FieldPath */
/** @typedef {{ message: string, edits: Edit[], isConflict: boolean }} Failure edits that were not made */
/** @typedef {{ send: (version: string) => Promise<Document>, edits: Edit[] }} PendingRequest that the server has not answered */

/** @param {FieldPath} path */
export const formatPath = (path) =>
  path.map((step, place) => (typeof step === "number" ? `[${step}]` : place ? `.${step}` : step)).join("");

/** @param {Edit[]} edits @returns {boolean} whether the page can tell what they make of the file */
const isForeseen = (edits) => edits.length > 0 && edits.every((edit) => edit.op !== "replace_text");

/** @param {Edit} edit @param {Edit[]} edits @returns {boolean} whether others give its field another value */
const isReplaced = (edit, edits) => edit.op === "set" && edits.some((other) => other.op === "set" && formatPath(other.path) === formatPath(edit.path));

export class OpenStudy {
  /** @param {string} key @param {() => void} changed is called after every change of what is shown */
  constructor(key, changed) {
    this.key = key;
    this.changed = changed;
    /** @type {Document | null} */
    this.document = null; // as it is once the edits on their way have been made
    /** @type {Document | null} */
    this._answer = null; // as the server last sent it
    /** @type {PendingRequest[]} */
    this._pending = [];
    /** @type {Failure | null} */
    this.failure = null;
    this.wasEditedElsewhere = false;
    this._queue = Promise.resolve();
    this._timer = 0;
    /** @type {Map<string, Promise<import("./messages").FieldForm>>} */
    this._forms = new Map();
  }

  async open() {
    this.show(await readStudy(this.key));
    const look = async () => {
      if (!document.hidden && !this.unsaved) await this._look();
      this._timer = setTimeout(look, LOOK_MS);
    };
    this._timer = setTimeout(look, LOOK_MS);
  }

  /** Read the file again, such as after what it may run has changed. */
  async reload() {
    this.show(await readStudy(this.key));
  }

  close() {
    clearTimeout(this._timer);
    this.changed = () => {};
  }

  /** The number of requests that the server has not answered. */
  get unsaved() { return this._pending.length; }

  /** Whether what the file will be is not known before the server answers: it steps back, or gets another text. */
  get isUnforeseen() { return this._pending.some(({ edits }) => !isForeseen(edits)); }

  async _look() {
    const version = this._answer?.version ?? "";
    const answer = await readStudy(this.key, version).catch(() => null);
    if (!answer || this.unsaved || answer.version === this._answer?.version) return;
    this.wasEditedElsewhere = true;
    this.show(answer);
  }

  /** Show the file as the server sent it, with the edits that are on their way. @param {Document | null} newest null leaves it */
  show(newest) {
    this._answer = newest ?? this._answer;
    this.document = this._answer && showEdits(this._answer, this._pending.flatMap((request) => request.edits));
    this.changed();
  }

  /**
   * Change the file: all edits or none. They are made after those before them, on the version that these left, and
   * shown at once, so that the next ones are addressed to what is there by then.
   * @param {Edit[]} edits @returns {Promise<boolean>} whether they were made
   */
  edit(edits) {
    return this._enqueue((version) => editStudy(this.key, version, edits), edits);
  }

  /** @param {"undo" | "redo"} way */
  step(way) {
    return this._enqueue((version) => stepHistory(this.key, version, way), []);
  }

  /** @param {(version: string) => Promise<Document>} send @param {Edit[]} edits @returns {Promise<boolean>} */
  _enqueue(send, edits) {
    const request = { send, edits };
    this._pending.push(request);
    const left = this.failure?.edits.filter((edit) => !isReplaced(edit, edits)) ?? [];
    this.failure = this.failure && left.length ? { ...this.failure, edits: left } : null;
    this.wasEditedElsewhere = false;
    this.show(null);
    const turn = this._queue.then(() => this._send(request));
    this._queue = turn.then(() => {});
    return turn;
  }

  /** @param {PendingRequest} request @returns {Promise<boolean>} whether it was carried out */
  async _send(request) {
    if (!this._pending.includes(request)) return false; // one before it failed, and it is among what is not saved
    try {
      const answer = await request.send(this._answer?.version ?? "");
      this._pending = this._pending.filter((other) => other !== request);
      this.show(answer);
      return true;
    } catch (error) {
      this._fail(request, error instanceof RefusedError ? error : null);
      return false;
    }
  }

  /**
   * Keep what was not made, to be made again. Requests behind one that met another file, or would have moved what they
   * are addressed to, are not sent.
   * @param {PendingRequest} request @param {RefusedError | null} refused null if there was no answer
   */
  _fail(request, refused) {
    const newest = refused?.refusal.document ?? null;
    const isAlone = refused !== null && newest === null && request.edits.every((edit) => edit.op === "set");
    const stopped = isAlone ? [request] : this._pending;
    const message = refused?.message ?? "The desk does not answer; is it still running?";
    const edits = [...(this.failure?.edits ?? []), ...stopped.flatMap((other) => other.edits)];
    this._pending = this._pending.filter((other) => !stopped.includes(other));
    this.failure = { message, edits, isConflict: newest !== null };
    this.show(newest);
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

  /** @returns {string[]} the names that tables of the study have, with those that are on their way */
  listNames() {
    const tables = Object.values(this.document?.tree ?? {}).filter(Array.isArray).flat();
    return tables.map((table) => table?.name).filter((name) => typeof name === "string");
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
