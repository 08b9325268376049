// The elements of one field of a form: a control for its type, and around it the label, sentence, default and mistakes.
/** @import { Document, Edit, FormField } from "./messages" */
/** @import { FieldPath, OpenStudy } from "./open_study.js" */
import { html, useEffect, useRef, useState } from "./vendor/preact.js";
import { buildMemberEdits } from "./edits.js";
import { TextInput } from "./text_input.js";
import { WorldButton } from "./worlds.js";
import { formatPath } from "./open_study.js";
import { formatContent, renderSentence, spellName } from "./words.js";
import { NestedForm, NestedForms } from "./form.js";
import { describeWorld, listMedia } from "./requests.js";

const TYPING_MS = 500; // without a key, after which a text is saved

/**
 * @typedef {object} ControlProperties
 * @property {OpenStudy} study
 * @property {FormField} field
 * @property {FieldPath} path of the field
 * @property {string} id
 * @property {string} describedBy
 * @property {any} content of the file; undefined if the file lacks the field
 * @property {boolean} isFixed
 * @property {(content: unknown) => void} save
 */

/** @param {Document | null} study @param {string} kind @param {string[]} choices @returns {string[]} what a name may be */
function listNames(study, kind, choices) {
  const tree = /** @type {any} */ (study?.tree ?? {});
  if (kind === "group") return (tree.groups ?? []).map((/** @type {any} */ group) => group.name);
  if (kind === "session") return (tree.sessions ?? []).map((/** @type {any} */ session) => session.name);
  if (kind === "block") return (tree.blocks ?? []).map((/** @type {any} */ block) => block.name);
  if (kind === "part") return (study?.parts ?? []).map((part) => part.name);
  return choices;
}

/** @param {unknown} content @param {string} type @param {string[]} [alternatives] @returns {unknown} what a typed text stands for */
function readTyped(content, type, alternatives = []) {
  const text = String(content).trim();
  const isNumeric = [type, ...alternatives].some((name) => name === "integer" || name === "number");
  if (isNumeric && text !== "" && Number.isFinite(Number(text))) return Number(text);
  return content;
}

/**
 * What a typed text stands for where another value was: a list stays a list, a number a number.
 * @param {string} text @param {unknown} before @param {string} type @returns {unknown} the value before, if the text is none of its kind
 */
export function readLike(text, before, type) {
  if (typeof before === "number") return readTyped(text, "number");
  if (typeof before === "boolean") return text.trim() === "true";
  if (typeof before !== "object" || before === null) return readTyped(text, type);
  try {
    const parsed = JSON.parse(text);
    return Array.isArray(parsed) === Array.isArray(before) && typeof parsed === "object" ? parsed : before;
  } catch {
    return before;
  }
}

/** @param {ControlProperties & { isLong?: boolean, type?: string }} properties */
function TextControl({ field, id, describedBy, content, isFixed, save, isLong = false, type = field.type }) {
  const [typed, setTyped] = useState(/** @type {string | null} */ (null));
  const timer = useRef(0);
  const isNumeric = type === "integer" || type === "number";
  const commit = (/** @type {string} */ text) => {
    clearTimeout(timer.current);
    if (text !== String(content ?? "")) save(readTyped(text, type, field.alternatives));
    setTyped(null);
  };
  const onInput = (/** @type {any} */ event) => {
    const text = event.target.value;
    setTyped(text);
    clearTimeout(timer.current);
    timer.current = setTimeout(() => save(readTyped(text, type, field.alternatives)), TYPING_MS);
  };
  useEffect(() => () => clearTimeout(timer.current), []);
  const shown = typed ?? String(content ?? "");
  const onBlur = (/** @type {any} */ event) => typed !== null && commit(event.target.value);
  const placeholder = field.default === null || field.default === "" ? "" : formatContent(field.default);
  const shared = { id, "aria-describedby": describedBy, disabled: isFixed, onInput, onBlur, placeholder };
  if (isLong) {
    const rows = Math.min(14, Math.max(3, shown.split("\n").length + 1));
    return html`<textarea ...${shared} rows=${rows} value=${shown} dir="auto"></textarea>`;
  }
  const mode = isNumeric ? { inputmode: "decimal", class: "number" } : { type: "text", dir: "auto" };
  return html`<input ...${shared} ...${mode} value=${shown}
    onKeyDown=${(/** @type {any} */ event) => event.key === "Enter" && commit(event.target.value)} />`;
}

/** @param {ControlProperties} properties */
function SwitchControl({ field, id, describedBy, content, isFixed, save }) {
  const isOn = content ?? field.default ?? false;
  return html`<label class="switch"><input type="checkbox" role="switch" id=${id} aria-describedby=${describedBy} checked=${isOn}
    disabled=${isFixed} onChange=${(/** @type {any} */ event) => save(event.target.checked)} /> <span>${isOn ? "Yes" : "No"}</span></label>`;
}

/** @param {ControlProperties & { names?: string[] }} properties */
function ChoiceControl({ field, id, describedBy, content, isFixed, save, names }) {
  const labels = new Map(field.choices.map((choice) => [choice.value, choice.label]));
  const choices = names ?? [...labels.keys()];
  const selected = content ?? field.default;
  const isKnown = choices.includes(selected);
  const onChange = (/** @type {any} */ event) => save(choices[Number(event.target.value)]);
  return html`<select id=${id} aria-describedby=${describedBy} disabled=${isFixed} onChange=${onChange}
      value=${isKnown ? String(choices.indexOf(selected)) : ""}>
    ${!isKnown && html`<option value="" disabled>${selected === null || selected === "" ? "choose" : String(selected)}</option>`}
    ${choices.map((choice, place) => html`<option value=${place}>${spellChoice(labels.get(choice) ?? choice)}</option>`)}
  </select>`;
}

/** @param {unknown} choice */
const spellChoice = (choice) => (choice === "" ? "none" : String(choice).replaceAll("_", " "));

/** @param {ControlProperties} properties */
function ListControl({ study, field, path, id, describedBy, content, isFixed }) {
  const members = /** @type {unknown[]} */ (content ?? field.default ?? []);
  const actions = useActions(field.references === "action" ? study.read([...path.slice(0, -1), "world"]) : undefined);
  const choices = field.type === "list" ? field.choices.map((choice) => String(choice.value)) : []; // else they take a list's place
  const listed = listNames(study.document, field.references, choices);
  const files = useFiles(study, isFile(field));
  const names = [actions, files].find((offered) => offered.length) ?? listed;
  const type = field.item || (members.every((member) => typeof member === "number") && members.length ? "number" : "string");
  const change = (/** @type {Edit} */ edit) => study.edit(buildMemberEdits(path, content, members, edit));
  const add = (/** @type {string} */ text) => text.trim() && change({ op: "insert", path: [members.length], value: readTyped(text.trim(), type) });
  const offered = names.filter((name) => !members.includes(name));
  return html`<div class="list" role="group" aria-describedby=${describedBy}>
    <ol>${members.map((member, place) => html`<li key=${`${place} ${member}`}>
      <span dir="auto">${formatContent(member)}</span>
      ${!isFixed && html`
        <button type="button" class="icon" disabled=${place === 0} aria-label=${`Move ${formatContent(member)} earlier`}
          onClick=${() => change({ op: "move", path: [place], to: place - 1 })}>↑</button>
        <button type="button" class="icon" aria-label=${`Remove ${formatContent(member)}`}
          onClick=${() => change({ op: "remove", path: [place] })}>×</button>`}
    </li>`)}</ol>
    ${!isFixed && (names.length ? html`<select id=${id} value="" onChange=${(/** @type {any} */ event) => { add(event.target.value); event.target.value = ""; }}>
        <option value="">add …</option>${offered.map((name) => html`<option value=${name}>${name}</option>`)}</select>`
      : html`<${AddText} id=${id} add=${add} />`)}
  </div>`;
}

/** @param {OpenStudy} study @param {boolean} isWanted @returns {string[]} the names of the files beside the protocol */
function useFiles(study, isWanted) {
  const [files, setFiles] = useState(/** @type {string[]} */ ([]));
  useEffect(() => {
    if (isWanted) listMedia(study.key).then((media) => setFiles(media.files.map((file) => file.name)), () => setFiles([]));
  }, [study.key, isWanted]);
  return files;
}

/** A file beside the protocol. @param {ControlProperties} properties */
function FileControl(properties) {
  const files = useFiles(properties.study, true);
  const isTable = properties.path.at(-2) === "stimuli";
  const offered = files.filter((name) => !isTable || name.endsWith(".csv"));
  if (!offered.length) return html`<${TextControl} ...${properties} />`;
  return html`<${ChoiceControl} ...${properties} names=${["", ...offered]} />`;
}

/** @param {FormField} field */
const isFile = (field) => field.references === "file" || field.name === "file";

/** @param {string | undefined} world @returns {string[]} the actions of a built-in world */
function useActions(world) {
  const [actions, setActions] = useState(/** @type {string[]} */ ([]));
  useEffect(() => {
    if (world) describeWorld(world).then((facts) => setActions(facts.actions), () => setActions([]));
  }, [world]);
  return actions;
}

/** @param {{ id: string, add: (text: string) => void }} properties */
function AddText({ id, add }) {
  const [typed, setTyped] = useState("");
  const commit = () => {
    add(typed);
    setTyped("");
  };
  return html`<span class="add"><input type="text" id=${id} value=${typed} placeholder="add …" dir="auto"
      onInput=${(/** @type {any} */ event) => setTyped(event.target.value)} onBlur=${commit}
      onKeyDown=${(/** @type {any} */ event) => event.key === "Enter" && commit()} /></span>`;
}

/** @param {ControlProperties} properties */
function PairControl(properties) {
  const { study, path, field, content } = properties;
  const pair = content ?? field.default ?? [0, 0];
  const written = Array.isArray(content) ? content : undefined; // one number may stand for both
  const set = (/** @type {number} */ place, /** @type {unknown} */ number) =>
    study.edit(buildMemberEdits(path, written, pair, { op: "set", path: [place], value: number }));
  return html`<div class="pair">${["first", "second"].map((word, place) => html`<${TextControl} ...${properties}
    id=${place ? `${properties.id}-second` : properties.id} type=${field.item || "number"} content=${pair[place]}
    save=${(/** @type {unknown} */ number) => set(place, number)} key=${word} />`)}</div>`;
}

/** Who holds each body of a team: a choice a seat. @param {ControlProperties} properties */
function SeatsControl({ study, path, field, id, describedBy, content, isFixed }) {
  const seats = /** @type {string[]} */ (content ?? []);
  const known = field.choices.map((choice) => String(choice.value));
  const change = (/** @type {Edit} */ edit) => study.edit(buildMemberEdits(path, content, seats, edit));
  const put = (/** @type {number} */ place, /** @type {string} */ seat) => change({ op: "set", path: [place], value: seat });
  return html`<div role="group" aria-describedby=${describedBy}><ol class="seats">${seats.map((seat, place) => html`<li key=${place}>
      <label for=${place ? `${id}-${place}` : id}>Seat ${place + 1}</label>
      <select id=${place ? `${id}-${place}` : id} value=${seat} disabled=${isFixed} onChange=${(/** @type {any} */ event) => put(place, event.target.value)}>
        ${[...new Set([seat, ...known])].map((name) => html`<option value=${name}>${name}</option>`)}</select></li>`)}</ol>
    ${!isFixed && html`<div class="buttons"><button type="button" class="small" onClick=${() => change({ op: "insert", path: [seats.length], value: known[0] })}>Add a seat</button>
      ${seats.length > 1 && html`<button type="button" class="small" onClick=${() => change({ op: "remove", path: [seats.length - 1] })}>Remove the last seat</button>`}</div>`}</div>`;
}

/** A part that a group has in place of another. @param {ControlProperties} properties */
function ReplacedParts({ study, path, id, content, isFixed }) {
  const pairs = /** @type {[string, string][]} */ (Object.entries(content ?? {}));
  const names = (study.document?.parts ?? []).map((part) => part.name);
  const change = (/** @type {Edit} */ edit) => study.edit(buildMemberEdits(path, content, {}, edit));
  const put = (/** @type {string} */ part, /** @type {string} */ other) => change({ op: "set", path: [part], value: other });
  return html`<div class="map">${pairs.map(([part, other]) => html`<div class="row" key=${part}><code>${part}</code>
      <select aria-label=${`Instead of ${part}`} value=${other} disabled=${isFixed} onChange=${(/** @type {any} */ event) => put(part, event.target.value)}>
        <option value="">nothing: it is left out</option>${names.filter((name) => name !== part).map((name) => html`<option value=${name}>${name}</option>`)}</select>
      <button type="button" class="icon" disabled=${isFixed} aria-label=${`Keep ${part}`}
        onClick=${() => change({ op: "remove", path: [part] })}>×</button></div>`)}
    ${!isFixed && html`<select id=${id} value="" onChange=${(/** @type {any} */ event) => { if (event.target.value) put(event.target.value, ""); event.target.value = ""; }}>
      <option value="">instead of …</option>${names.filter((name) => !(name in (content ?? {}))).map((name) => html`<option value=${name}>${name}</option>`)}</select>`}</div>`;
}

/** @param {ControlProperties} properties */
function MapControl({ study, path, field, id, content, isFixed }) {
  const pairs = Object.entries(content ?? {});
  const [name, setName] = useState("");
  const change = (/** @type {Edit} */ edit) => study.edit(buildMemberEdits(path, content, {}, edit));
  const set = (/** @type {string} */ key, /** @type {string} */ text) => change({ op: "set", path: [key], value: readLike(text, content?.[key], field.item) });
  const remove = (/** @type {string} */ key) => change({ op: "remove", path: [key] });
  const commit = () => {
    if (name.trim()) set(name.trim(), "");
    setName("");
  };
  return html`<div class="map">
    ${pairs.map(([key, member]) => html`<div class="row" key=${key}><code>${key}</code>
      <${TextInput} aria-label=${`${spellName(field.name)}: ${key}`} value=${typeof member === "object" ? JSON.stringify(member) : String(member)}
        disabled=${isFixed} dir="auto" save=${(/** @type {string} */ text) => set(key, text)} />
      <button type="button" class="icon" disabled=${isFixed} aria-label=${`Remove ${key}`} onClick=${() => remove(key)}>×</button></div>`)}
    ${!isFixed && html`<input type="text" id=${id} value=${name} placeholder="add a name …" onInput=${(/** @type {any} */ event) => setName(event.target.value)}
      onBlur=${commit} onKeyDown=${(/** @type {any} */ event) => event.key === "Enter" && commit()} />`}
  </div>`;
}

/** @param {ControlProperties} properties */
function AnyControl(properties) {
  const { content, save, isFixed, id, describedBy } = properties;
  const [problem, setProblem] = useState("");
  const isPlain = ["string", "number", "boolean"].includes(typeof content);
  const read = (/** @type {string} */ typed) => {
    const text = typed.trim();
    try {
      save(/^[[{"]|^-?\d|^(true|false)$/.test(text) ? JSON.parse(text) : text);
      setProblem("");
    } catch {
      setProblem("This is neither a number, a word, nor a list such as [1, 2].");
    }
  };
  return html`<${TextInput} id=${id} aria-describedby=${describedBy} disabled=${isFixed} save=${read}
      value=${content === undefined ? "" : isPlain ? String(content) : JSON.stringify(content)} />
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}`;
}

const LISTS = ["list", "pair", "tables", "any"];
const TABLES = ["table", "map", "any"];

/** @param {unknown} content */
const isTable = (content) => typeof content === "object" && content !== null && !Array.isArray(content);

/** A control for what the file has, which may be another of a field's types. @param {ControlProperties} properties @returns {import("./vendor/preact.js").VNode} */
function Control(properties) {
  const { field, study, content } = properties;
  const names = listNames(study.document, field.references, []);
  if (Array.isArray(content) && !LISTS.includes(field.type)) return html`<${ListControl} ...${properties} />`;
  if (isTable(content) && !TABLES.includes(field.type)) return html`<${MapControl} ...${properties} />`;
  if (field.references === "world" && field.type === "string") return html`<${WorldButton} ...${properties} />`;
  if (field.type === "string" && isFile(field)) return html`<${FileControl} ...${properties} />`;
  if (field.type === "string" && names.length) return html`<${ChoiceControl} ...${properties} names=${["", ...names]} />`;
  switch (field.type) {
    case "boolean": return html`<${SwitchControl} ...${properties} />`;
    case "choice": return html`<${ChoiceControl} ...${properties} />`;
    case "text": return html`<${TextControl} ...${properties} isLong />`;
    case "list": return html`<${field.name === "seats" ? SeatsControl : ListControl} ...${properties} />`;
    case "pair": return html`<${PairControl} ...${properties} />`;
    case "map": return html`<${field.references === "part" ? ReplacedParts : MapControl} ...${properties} />`;
    case "table": return html`<${NestedForm} ...${properties} />`;
    case "tables": return html`<${NestedForms} ...${properties} />`;
    case "any": return html`<${AnyControl} ...${properties} />`;
    default: return html`<${TextControl} ...${properties} />`;
  }
}

/** @param {FormField} field @returns {string} the default in words; "" where there is nothing to say */
function describeDefault(field) {
  if (field.required || ["table", "tables", "map"].includes(field.type)) return "";
  if (field.default === null || field.default === "") return "";
  return formatContent(field.default);
}

const UNITS = /** @type {Record<string, string>} */ ({ ms: "milliseconds", s: "seconds", px: "pixels", min: "minutes" });

/**
 * A field with its label, sentence, example, default, control and mistakes.
 * @param {{ study: OpenStudy, field: FormField, path: FieldPath, content: any, save: (content: unknown) => void, clear?: () => void }} properties
 */
export function Field({ study, field, path, content, save, clear }) {
  const id = `field-${formatPath(path).replace(/[^\w]+/g, "-")}`;
  const mistakes = study.mistakesAt(path);
  const restriction = study.restrictionAt(path);
  const isNested = field.type === "table" || field.type === "tables";
  const usual = describeDefault(field);
  const hint = field.example !== null && field.example !== undefined && content === undefined && !isNested;
  const describedBy = `${id}-about${mistakes.length ? ` ${id}-mistakes` : ""}`;
  return html`<div class=${`field type-${field.type} ${mistakes.length ? "wrong" : ""}`}>
    <div class="label"><label for=${id}>${spellName(field.name)}${field.required && html`<span class="required" title="required"> *</span>`}</label>
      ${field.unit && html`<span class="unit">${UNITS[field.unit] ?? field.unit}</span>`}
      ${clear && content !== undefined && !restriction && html`<button type="button" class="quiet small" aria-label=${`Remove ${spellName(field.name)}`}
        onClick=${clear}>remove</button>`}</div>
    <p class="about" id=${`${id}-about`}>${renderSentence(field.sentence)}${usual && html` <span class="usual">Usually ${usual}.</span>`}
      ${hint && html` <span class="usual">For example <code>${formatContent(field.example)}</code>.</span>`}</p>
    <${Control} study=${study} field=${field} path=${path} id=${id} describedBy=${describedBy} content=${content}
      isFixed=${restriction !== ""} save=${save} />
    ${restriction && html`<p class="fixed">Fixed: ${restriction}</p>`}
    ${mistakes.length > 0 && html`<ul class="mistakes" id=${`${id}-mistakes`} role="alert">
      ${mistakes.filter((mistake) => !isNested || mistake.path.length === path.length).map((mistake) => html`<li>${mistake.message}</li>`)}</ul>`}
  </div>`;
}
