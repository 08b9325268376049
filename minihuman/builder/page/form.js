// Forms made of the schema: the fields of a table that the file has, and a search for those that it could have.
/** @import { Edit, FieldForm, FormField } from "./messages" */
/** @import { FieldPath, OpenStudy } from "./open_study.js" */
/** @import { ControlProperties } from "./fields.js" */
import { html, useEffect, useMemo, useState } from "./vendor/preact.js";
import { Field } from "./fields.js";
import { makeName, spellName, stripMarks } from "./words.js";

const LONGEST_SHORT_FORM = 6; // fields; a form without more shows them all
const MOST_COMMON = 12; // fields that most studies have; a form with more shows only those that the file has

/** @param {OpenStudy} study @param {string} table @param {string} kind @returns {FieldForm | null} */
export function useForm(study, table, kind = "") {
  const [form, setForm] = useState(/** @type {FieldForm | null} */ (null));
  useEffect(() => {
    let isWanted = true;
    study.form(table, kind).then((answer) => isWanted && setForm(answer), () => isWanted && setForm(null));
    return () => { isWanted = false; };
  }, [study, table, kind]);
  return form;
}

/**
 * The fields of a table that exists in the file, or would with its first field.
 * @param {{ study: OpenStudy, path: FieldPath, table: string, kind?: string, hidden?: string[], essential?: string[],
 *   content?: any, save?: (name: string, content: unknown) => void, base?: any }} properties base: what holds where the table lacks a field
 */
export function TableForm({ study, path, table, kind = "", hidden = [], essential = [], content, save, base }) {
  const form = useForm(study, table, kind);
  const [added, setAdded] = useState(/** @type {string[]} */ ([]));
  const fields = content ?? study.read(path);
  useEffect(() => setAdded([]), [path.join(), table, kind]);
  if (!form) return html`<p class="quiet" role="status">Loading the form …</p>`;
  const set = save ?? ((/** @type {string} */ name, /** @type {unknown} */ part) => saveField(study, path, name, part));
  const clear = (/** @type {FormField} */ field) => {
    setAdded(added.filter((name) => name !== field.name));
    study.edit([{ op: "remove", path: [...path, field.name] }]);
  };
  const offered = form.fields.filter((field) => !hidden.includes(field.name)).map((field) => (base ? buildOverride(field, base) : field));
  const isShort = offered.length <= LONGEST_SHORT_FORM;
  const isLong = offered.filter((field) => field.common).length > MOST_COMMON;
  const isShown = (/** @type {FormField} */ field) =>
    (isShort && !base) || field.required || essential.includes(field.name) || (field.common && !isLong && !base) || added.includes(field.name) || fields?.[field.name] !== undefined
    || study.mistakesAt([...path, field.name]).length > 0;
  const shown = offered.filter(isShown);
  const others = offered.filter((field) => !isShown(field)).toSorted((a, b) => Number(b.common) - Number(a.common));
  return html`<div class="table-form">
    ${shown.map((field) => html`<${Field} key=${field.name} study=${study} field=${field} path=${[...path, field.name]}
      content=${fields?.[field.name]} save=${(/** @type {unknown} */ part) => set(field.name, part)}
      clear=${field.required ? undefined : () => clear(field)} />`)}
    ${others.length > 0 && html`<${MoreFields} fields=${others} add=${(/** @type {string} */ name) => setAdded([...added, name])} />`}
  </div>`;
}

/** A field that a group may have otherwise: not required, and by default as in the table for every group. @param {FormField} field @param {any} base @returns {FormField} */
function buildOverride(field, base) {
  const usual = base[field.name];
  return { ...field, required: false, default: usual ?? field.default, example: usual ?? field.example };
}

/** @param {OpenStudy} study @param {FieldPath} path @param {string} name @param {unknown} content */
function saveField(study, path, name, content) {
  if (study.read(path) === undefined) return study.edit([{ op: "set", path, value: { [name]: content } }]);
  return study.edit([{ op: "set", path: [...path, name], value: content }]);
}

/** @param {{ fields: FormField[], add: (name: string) => void }} properties */
function MoreFields({ fields, add }) {
  const [wanted, setWanted] = useState("");
  const [isOpen, setOpen] = useState(false);
  const matches = useMemo(() => {
    const words = wanted.toLowerCase().split(/\s+/).filter(Boolean);
    return fields.filter((field) => words.every((word) =>
      `${spellName(field.name)} ${field.name} ${field.sentence}`.toLowerCase().includes(word)));
  }, [wanted, fields]);
  return html`<section class="more" aria-label="Further settings">
    <button type="button" class="disclosure" aria-expanded=${isOpen} onClick=${() => setOpen(!isOpen)}>
      <span aria-hidden="true">${isOpen ? "▾" : "▸"}</span> Further settings (${fields.length})</button>
    ${isOpen && html`<input type="search" aria-label="Search further settings" placeholder="Search: deadline, feedback, points …" value=${wanted}
        onInput=${(/** @type {any} */ event) => setWanted(event.target.value)} />
      <ul>${matches.map((field) => html`<li key=${field.name}><button type="button" class="setting" onClick=${() => add(field.name)}>
        <strong>${spellName(field.name)}</strong> <span>${stripMarks(field.sentence)}</span></button></li>`)}</ul>
      ${matches.length === 0 && html`<p class="quiet">No setting has these words.</p>`}`}
  </section>`;
}

/** A table within a table, such as the points of a block. @param {ControlProperties} properties */
export function NestedForm({ study, field, path, content, isFixed, save, id }) {
  if (isFixed) return null;
  if (content === undefined || content === null) {
    const words = `Add ${spellName(field.name).toLowerCase()}`; // its name, too: the field's label would name it by the field alone
    return html`<button type="button" id=${id} class="small" aria-label=${words} onClick=${() => save(field.example ?? {})}>${words}</button>`;
  }
  return html`<fieldset id=${id} aria-label=${spellName(field.name)}>
    <${TableForm} study=${study} path=${path} table=${field.table} content=${content} /></fieldset>`;
}

/** An array of tables within a table, such as the questions of a questionnaire. @param {ControlProperties} properties */
export function NestedForms({ study, field, path, content, isFixed, id }) {
  const members = /** @type {any[]} */ (content ?? []);
  const add = () => {
    const example = Array.isArray(field.example) ? field.example[0] ?? {} : {};
    const taken = members.map((member) => member.name).filter(Boolean);
    const fresh = example.name ? { ...example, name: makeName(example.name, taken) } : example;
    insertTable(study, path, members.length, fresh);
  };
  return html`<div class="tables" id=${id}>
    ${members.map((member, place) => html`<details key=${place} open=${study.mistakesAt([...path, place]).length > 0}>
      <summary>${member.name ?? member.label ?? `${spellName(field.name)} ${place + 1}`}</summary>
      <${TableForm} study=${study} path=${[...path, place]} table=${field.table} />
      ${!isFixed && html`<${TableButtons} study=${study} path=${path} place=${place} count=${members.length} name=${member.name ?? place + 1} />`}
    </details>`)}
    ${!isFixed && html`<button type="button" class="small" onClick=${add}>Add to ${spellName(field.name).toLowerCase()}</button>`}
  </div>`;
}

/** @param {OpenStudy} study @param {FieldPath} path of the array @param {number} place @param {unknown} table */
export function insertTable(study, path, place, table) {
  return study.edit([buildInsertion(study, path, place, table)]);
}

/** @param {OpenStudy} study @param {FieldPath} path @param {number} place @param {unknown} table @returns {Edit} */
export function buildInsertion(study, path, place, table) {
  return { op: "insert", path: [...path, place], value: table };
}

/** @param {{ study: OpenStudy, path: FieldPath, place: number, count: number, name: string | number }} properties */
export function TableButtons({ study, path, place, count, name }) {
  const move = (/** @type {number} */ to) => study.edit([{ op: "move", path: [...path, place], to }]);
  return html`<div class="buttons">
    <button type="button" class="small" disabled=${place === 0} aria-label=${`Move ${name} earlier`} onClick=${() => move(place - 1)}>Earlier</button>
    <button type="button" class="small" disabled=${place === count - 1} aria-label=${`Move ${name} later`} onClick=${() => move(place + 1)}>Later</button>
    <button type="button" class="small danger" aria-label=${`Remove ${name}`} onClick=${() => study.edit([{ op: "remove", path: [...path, place] }])}>Remove</button>
  </div>`;
}
