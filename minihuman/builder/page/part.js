// A part's form: its name, its settings, and for questionnaires the questions one below the other.
/** @import { Part, PartKind } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useState } from "./vendor/preact.js";
import { useKinds } from "./add_part.js";
import { OpenPlaces } from "./consent.js";
import { WORLD as LEVEL } from "./level.js";
import { LevelEditor } from "./level_editor.js";
import { TableButtons, TableForm, insertTable } from "./form.js";
import { buildLeaveEdits } from "./lanes.js";
import { TextInput } from "./text_input.js";
import { TimelineEditor } from "./timeline_editor.js";
import { makeName, nameKind, spellName, stripMarks } from "./words.js";

const ESSENTIAL = /** @type {Record<string, string[]>} */ ({ // shown though the file lacks them
  blocks: ["instructions", "key_map", "show_keys", "feedback"],
  pages: ["title", "text"],
  questions: ["title", "form"],
  orders: ["parts", "order"],
  activities: ["settings"],
});

/** @param {{ study: OpenStudy, part: Part, deselect: () => void }} properties */
export function PartForm({ study, part, deselect }) {
  const [table, place] = /** @type {[string, number]} */ (part.path);
  const kind = table === "blocks" || table === "activities" ? part.kind : "";
  const isLevel = table === "blocks" && study.read([...part.path, "world"]) === LEVEL;
  const hasTrials = table === "blocks" && part.kind === "trials";
  const isPlain = Object.keys(study.read([...part.path, "options"]) ?? {}).every((name) => name === "diagram" || name === "mission");
  const hidden = ["name", "kind", ...(table === "questions" ? ["items"] : []), ...(isLevel && isPlain ? ["options"] : []), ...(hasTrials ? ["timeline"] : [])];
  const [group, setGroup] = useState("");
  const path = group ? [...part.path, "group_overrides", group] : part.path;
  return html`<article class="part-form" aria-label=${`Part ${part.name}`}>
    <header><p class="kind">${nameKind(part.kind)}<small>line ${part.line} of the file</small></p>
      <${NameField} key=${part.name} study=${study} part=${part} />
      <${PartButtons} study=${study} part=${part} table=${table} place=${place} deselect=${deselect} /></header>
    ${["blocks", "pages", "questions"].includes(table) && html`<${GroupChoice} study=${study} part=${part} group=${group} choose=${setGroup} />`}
    ${!group && table === "questions" && html`<${Questions} study=${study} path=${[...part.path, "items"]} />`}
    ${!group && study.read([...part.path, "asks_consent"]) && html`<${OpenPlaces} study=${study} path=${[...part.path, "text"]} />`}
    ${!group && hasTrials && html`<${TimelineEditor} key=${part.name} study=${study} path=${part.path} />`}
    ${!group && isLevel && html`<${LevelEditor} key=${part.name} study=${study} path=${part.path} />`}
    <${TableForm} key=${group} study=${study} path=${path} table=${table} kind=${kind} hidden=${[...hidden, "group_overrides"]} essential=${group ? [] : ESSENTIAL[table] ?? []}
      base=${group ? study.read(part.path) : undefined} />
  </article>`;
}

/** For whom the form's fields are: for every group, or for one that has them otherwise. @param {{ study: OpenStudy, part: Part, group: string, choose: (group: string) => void }} properties */
function GroupChoice({ study, part, group, choose }) {
  const groups = /** @type {any[]} */ (study.read(["groups"]) ?? []).map((other) => other.name);
  const overridden = study.read([...part.path, "group_overrides"]) ?? {};
  if (groups.length < 2 && !Object.keys(overridden).length) return null;
  return html`<div class="for-group"><div class="segments" role="group" aria-label="For whom these settings are">
    <button type="button" aria-pressed=${group === ""} onClick=${() => choose("")}>Every group</button>
    ${groups.map((name) => html`<button type="button" key=${name} aria-pressed=${group === name} onClick=${() => choose(name)}>${name}${name in overridden ? " •" : ""}</button>`)}</div>
    ${group && html`<span class="quiet">Only what differs for ${group}; all else is as for every group.</span>`}</div>`;
}

/** @param {{ study: OpenStudy, part: Part }} properties */
function NameField({ study, part }) {
  const rename = (/** @type {string} */ text) => {
    const name = text.trim();
    if (name && name !== part.name) study.edit([{ op: "rename", path: part.path, value: name }]);
  };
  const isFixed = study.restrictionAt([...part.path, "name"]) !== "";
  return html`<label class="name-field">Name <${TextInput} value=${part.name} disabled=${isFixed} save=${rename} /></label>`;
}

/** @param {{ study: OpenStudy, part: Part, table: string, place: number, deselect: () => void }} properties */
function PartButtons({ study, part, table, place, deselect }) {
  const copy = () => study.edit([{ op: "duplicate", path: part.path, value: { name: makeName(part.name, study.listNames()) } }]);
  const remove = () => {
    const paths = new Map((study.document?.lanes ?? []).map((lane) => [lane.path.join(), lane]));
    const edits = [...paths.values()].flatMap((lane) => buildLeaveEdits(lane, part.name));
    study.edit([...edits, { op: "remove", path: [table, place] }]);
    deselect();
  };
  return html`<div class="buttons"><button type="button" class="small" onClick=${copy}>Copy</button>
    <button type="button" class="small danger" onClick=${remove}>Remove from the study</button></div>`;
}

/** @param {{ study: OpenStudy, path: (string | number)[] }} properties */
function Questions({ study, path }) {
  const kinds = useKinds();
  const [open, setOpen] = useState(-1);
  const items = /** @type {any[]} */ (study.read(path) ?? []);
  const add = (/** @type {PartKind} */ kind) => {
    const name = makeName(kind.kind, items.map((item) => item.name));
    insertTable(study, path, items.length, { ...kind.new, name });
    setOpen(items.length);
  };
  return html`<section class="questions" aria-label="Questions"><h3>Questions</h3>
    <ol>${items.map((item, place) => html`<${Question} key=${place} study=${study} path=${path} place=${place} item=${item} count=${items.length}
      isOpen=${open === place} toggle=${() => setOpen(open === place ? -1 : place)} />`)}</ol>
    <div class="add-question"><span>Add a question:</span>${(kinds?.questions ?? []).map((kind) => html`
      <button type="button" class="small" key=${kind.kind} title=${stripMarks(kind.summary)} onClick=${() => add(kind)}>${spellName(kind.kind)}</button>`)}</div>
  </section>`;
}

/** @param {any} properties */
function Question({ study, path, place, item, count, isOpen, toggle }) {
  const mistakes = study.mistakesAt([...path, place]).length;
  return html`<li class=${mistakes ? "wrong" : ""}>
    <button type="button" class="question" aria-expanded=${isOpen} onClick=${toggle}>
      <span class="kind">${spellName(item.kind ?? "question")}</span> <span dir="auto">${item.ask || item.name}</span>
      ${mistakes > 0 && html` <span class="badge">${mistakes}</span>`}</button>
    ${isOpen && html`<div class="question-form">
      <${TableForm} study=${study} path=${[...path, place]} table="questions.items" kind=${item.kind} hidden=${["kind"]} essential=${["name", "ask"]} />
      <${TableButtons} study=${study} path=${path} place=${place} count=${count} name=${item.name} /></div>`}
  </li>`;
}
