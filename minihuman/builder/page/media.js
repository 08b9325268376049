// The files beside a protocol: pictures and sounds to see and hear, and tables of stimuli to paste and edit.
/** @import { Media, MediaFile, StimulusTable } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { RefusedError, listMedia, mediaAddress, readTable, sendFile, writeTable } from "./requests.js";
import { formatPath } from "./open_study.js";
import { TextInput } from "./text_input.js";
import { countNoun, makeName } from "./words.js";

/** @param {{ study: OpenStudy }} properties */
export function MediaView({ study }) {
  const [media, setMedia] = useState(/** @type {Media | null} */ (null));
  const [problem, setProblem] = useState("");
  const [table, setTable] = useState("");
  const [isOver, setOver] = useState(false);
  const refresh = () => listMedia(study.key).then(setMedia, (error) => setProblem(error.message));
  useEffect(() => { refresh(); }, [study.document?.version]);
  const files = media?.files ?? [];
  const send = async (/** @type {Iterable<File>} */ chosen) => {
    setProblem("");
    for (const file of chosen) {
      await sendInto(study.key, file).then(setMedia, (error) => setProblem(error.message));
    }
  };
  const onDrop = (/** @type {DragEvent} */ event) => {
    event.preventDefault();
    setOver(false);
    send(event.dataTransfer?.files ?? []);
  };
  const newTable = async () => {
    const name = `${makeName("stimuli", files.map((file) => file.name.replace(/\.csv$/, "")))}.csv`;
    const fresh = { name, columns: ["text", "correct"], rows: [["GO", "press"], ["STOP", ""]] };
    await writeTable(study.key, fresh).then(() => { refresh(); setTable(name); }, (error) => setProblem(error.message));
  };
  return html`<section class="media" aria-label="Tables and media">
    <label class=${`drop ${isOver ? "over" : ""}`} onDragOver=${(/** @type {DragEvent} */ event) => { event.preventDefault(); setOver(true); }}
      onDragLeave=${() => setOver(false)} onDrop=${onDrop}>Drop pictures, sounds and tables here, or <span class="link">choose files</span>
      <input type="file" multiple class="unseen" onChange=${(/** @type {any} */ event) => send(event.target.files)} /></label>
    <button type="button" onClick=${newTable}>New table of stimuli</button>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    <ul class="files">${files.map((file) => html`<${FileCard} key=${file.name} study=${study} file=${file} isOpen=${table === file.name}
      open=${() => setTable(table === file.name ? "" : file.name)} />`)}</ul>
    ${files.length === 0 && html`<p class="quiet">There are no files beside this study yet.</p>`}
    ${table && html`<${TableEditor} key=${table} study=${study} name=${table} />`}
  </section>`;
}

/** @param {string} key @param {File} file @returns {Promise<Media>} */
async function sendInto(key, file) {
  try {
    return await sendFile(key, file);
  } catch (error) {
    const exists = error instanceof RefusedError && error.refusal.error === "exists";
    if (!exists || !confirm(`${file.name} is there already. Replace it?`)) throw error;
    return sendFile(key, file, true);
  }
}

/** @param {{ study: OpenStudy, file: MediaFile, isOpen: boolean, open: () => void }} properties */
function FileCard({ study, file, isOpen, open }) {
  const address = mediaAddress(study.key, file.name);
  const use = file.used_at.map((path) => formatPath(path)).join(", ");
  return html`<li class="file">
    ${file.media_type.startsWith("image/") && html`<img src=${address} alt="" loading="lazy" />`}
    ${file.media_type.startsWith("audio/") && html`<audio controls src=${address} aria-label=${file.name}></audio>`}
    <strong>${file.name}</strong><span class="quiet">${formatBytes(file.bytes)}${use ? `; used at ${use}` : "; not used"}</span>
    ${file.name.endsWith(".csv") && html`<button type="button" class="small" aria-expanded=${isOpen} onClick=${open}>Edit the table</button>`}
  </li>`;
}

/** @param {number} bytes */
const formatBytes = (bytes) => (bytes < 10_000 ? `${bytes} bytes` : `${Math.round(bytes / 1000)} kB`);

/** A table that is open on the page, with what is on its way to the file: each edit is made of what those before it leave. */
export class OpenTable {
  /** @param {string} key of the study @param {string} name @param {() => void} changed is called after every change of what is shown */
  constructor(key, name, changed) {
    this.key = key;
    this.name = name;
    this.changed = changed;
    /** @type {StimulusTable | null} */
    this.table = null;
    this.problem = "";
    this.isPasting = false; // what the table will be is not known yet
    this._version = ""; // of the file, as the server last sent it
    this.unsaved = 0; // requests that the server has not answered
    this._queue = Promise.resolve();
  }

  async read() {
    try {
      const answer = await readTable(this.key, this.name);
      this._version = answer.version;
      this.table = answer;
    } catch (error) {
      this.problem = describeProblem(error);
    }
    this.changed();
  }

  /** @param {Partial<StimulusTable>} change @returns {Promise<void>} */
  write(change) {
    if (!this.table) return Promise.resolve();
    this.table = { ...this.table, ...change };
    const { columns, rows } = this.table;
    return this._enqueue({ columns, rows });
  }

  /** @param {string} pasted cells of a spreadsheet, which take the place of the table's @returns {Promise<void>} */
  paste(pasted) {
    this.isPasting = true;
    return this._enqueue({ columns: [], rows: [], pasted });
  }

  /** @param {{ columns: string[], rows: string[][], pasted?: string }} content @returns {Promise<void>} */
  _enqueue(content) {
    this.unsaved += 1;
    this.changed();
    this._queue = this._queue.then(() => this._send(content));
    return this._queue;
  }

  /** @param {{ columns: string[], rows: string[][], pasted?: string }} content */
  async _send(content) {
    this.unsaved -= 1;
    try {
      const answer = await writeTable(this.key, { name: this.name, version: this._version, ...content });
      this._version = answer.version;
      this.problem = "";
      if (!this.unsaved) this.table = answer;
    } catch (error) {
      this.problem = describeProblem(error);
      if (isConflict(error)) await this.read(); // what the next edits are made of
    }
    if (content.pasted) this.isPasting = false;
    this.changed();
  }
}

/** @param {unknown} error */
const isConflict = (error) => error instanceof RefusedError && error.refusal.error === "conflict";

/** @param {unknown} error @returns {string} */
const describeProblem = (error) => (error instanceof RefusedError ? error.message : "The desk does not answer; is it still running?");

/** @param {{ study: OpenStudy, name: string }} properties */
function TableEditor({ study, name }) {
  const [, redraw] = useState(0);
  const [open] = useState(() => new OpenTable(study.key, name, () => redraw((count) => count + 1)));
  useEffect(() => { open.read(); }, [open]);
  const { table, problem } = open;
  if (!table) return html`<p class="quiet" role="status">${problem || "Opening the table …"}</p>`;
  const save = (/** @type {Partial<StimulusTable>} */ change) => open.write(change);
  const paste = (/** @type {ClipboardEvent} */ event) => {
    const text = event.clipboardData?.getData("text/plain") ?? "";
    if (!/[\t\n]/.test(text.trim())) return;
    event.preventDefault();
    open.paste(text);
  };
  return html`<section class="table-editor" aria-label=${`Table ${name}`} onPaste=${paste} inert=${open.isPasting}>
    <h3>${name} <small>${countNoun(table.rows.length, "row")}</small> <small role="status">${open.unsaved ? "Saving …" : !problem && "Cells saved"}</small></h3>
    <p class="quiet">Copy the cells of a spreadsheet, names of columns first, click into the table and paste. A column that is no option of the
      world is a label of the trial and a column of the data.</p>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}
    <${Cells} table=${table} save=${save} />
    <div class="buttons"><button type="button" class="small" onClick=${() => save({ rows: [...table.rows, table.columns.map(() => "")] })}>Add a row</button>
      <button type="button" class="small" onClick=${() => save({ columns: [...table.columns, makeName("label", table.columns)], rows: table.rows.map((row) => [...row, ""]) })}>Add a column</button></div>
  </section>`;
}

/** @param {{ table: StimulusTable, save: (change: Partial<StimulusTable>) => void }} properties */
function Cells({ table, save }) {
  const setName = (/** @type {number} */ place, /** @type {string} */ text) => save({ columns: table.columns.with(place, text) });
  const setCell = (/** @type {number} */ row, /** @type {number} */ place, /** @type {string} */ text) =>
    save({ rows: table.rows.with(row, table.rows[row].with(place, text)) });
  return html`<div class="cells" tabindex="0"><table><thead><tr><th scope="col"><span class="unseen">row</span></th>${table.columns.map((column, place) => html`<th scope="col">
      <${TextInput} aria-label=${`Name of column ${place + 1}`} value=${column} save=${(/** @type {string} */ text) => setName(place, text)} /></th>`)}
      <th><span class="unseen">remove</span></th></tr></thead>
    <tbody>${table.rows.map((row, number) => html`<tr key=${number}><th scope="row">${number + 1}</th>
      ${row.map((cell, place) => html`<td><${TextInput} dir="auto" aria-label=${`${table.columns[place]}, row ${number + 1}`} value=${cell}
        save=${(/** @type {string} */ text) => setCell(number, place, text)} /></td>`)}
      <td><button type="button" class="icon" aria-label=${`Remove row ${number + 1}`} onClick=${() => save({ rows: table.rows.toSpliced(number, 1) })}>×</button></td></tr>`)}</tbody>
  </table></div>`;
}
