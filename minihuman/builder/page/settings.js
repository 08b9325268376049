// The settings of a study as a whole: what it is, its groups, payment, recruitment, analysis; and the file itself.
/** @import { Document } from "./messages" */
/** @import { OpenStudy } from "./open_study.js" */
import { html, useState } from "./vendor/preact.js";
import { OpenPlaces, ProcessingRecord } from "./consent.js";
import { TableButtons, TableForm, insertTable } from "./form.js";
import { makeName } from "./words.js";

export const RECORD = "processing"; // a section that is no table
/** @typedef {{ table: string, name: string, about: string, essential?: string[], list?: any }} Section */
/** @type {Section[]} */
const SECTIONS = [
  { table: "study", name: "Study", about: "Its name, language, number of participants, consent and last words.", essential: ["participants", "language", "consent", "closing", "theme"] },
  { table: "groups", name: "Groups", about: "Who does what. Participants are allocated to groups in balanced order.", list: { name: "group" } },
  { table: "orders", name: "Orders", about: "Parts whose order depends on the participant: shuffled, or a Latin square.", list: { name: "order", parts: [], order: "latin-square" } },
  { table: "sessions", name: "Sessions", about: "Days: what is done on each, and how many days lie between them.", list: { name: "day", parts: [] } },
  { table: "keys", name: "Keys", about: "The keys on which actions may land." },
  { table: "bonus", name: "Payment", about: "What participants get: a base, and an amount per point." },
  { table: "web", name: "Recruitment and browser", about: "Where participants come from, which devices may take part, and their completion codes.", essential: ["recruitment_platforms", "require_keyboard", "open_access"] },
  { table: "about", name: "About", about: "Title, authors, licence and ethics approval, for archives.", essential: ["title", "description", "authors", "ethics_approvals"] },
  { table: "design", name: "Question and design", about: "The study's question and the effect that it is about.", essential: ["question", "primary_effect"] },
  { table: "analysis", name: "Analysis", about: "The measures that are named before the data are seen.", essential: ["primary_measure", "block"] },
  { table: "exclusions", name: "Exclusions", about: "Rules, fixed beforehand, that leave data out of the report.", list: { reason: "", level: "participant", measure: "success", below: 0.5 } },
  { table: RECORD, name: "Record of processing", about: "One page for the data protection officer, made of what the file says." },
  { table: "allocation", name: "Allocation", about: "Groups that are drawn by an answer, or by an adaptive design." },
];

/** @param {{ study: OpenStudy, selected: string }} properties */
export function Settings({ study, selected }) {
  const [table, setTable] = useState(SECTIONS.some((other) => other.table === selected) ? selected : "study");
  const section = /** @type {Section} */ (SECTIONS.find((other) => other.table === table));
  return html`<div class="settings"><nav aria-label="Settings of the study"><ul>${SECTIONS.map((other) => html`<li key=${other.table}>
      <button type="button" aria-current=${other.table === table ? "true" : undefined} onClick=${() => setTable(other.table)}>${other.name}
        ${study.mistakesAt([other.table]).length > 0 && html` <span class="badge">${study.mistakesAt([other.table]).length}</span>`}</button></li>`)}</ul></nav>
    <section aria-label=${section.name}><h2>${section.name}</h2><p class="quiet">${section.about}</p>
      ${table === "study" && html`<${OpenPlaces} study=${study} path=${["study", "consent"]} />`}
      ${renderSection(study, section)}
    </section></div>`;
}

/** @param {OpenStudy} study @param {Section} section */
function renderSection(study, section) {
  const { table } = section;
  if (table === RECORD) return html`<${ProcessingRecord} study=${study} />`;
  if (section.list) return html`<${TableList} study=${study} section=${section} />`;
  return html`<${TableForm} study=${study} path=${[table]} table=${table} essential=${section.essential ?? []} />`;
}

/** @param {{ study: OpenStudy, section: Section }} properties */
function TableList({ study, section }) {
  const { table, list } = section;
  const tables = /** @type {any[]} */ (study.read([table]) ?? []);
  const add = () => {
    const fresh = { ...list };
    if (fresh.name) fresh.name = makeName(fresh.name, tables.map((other) => other.name));
    if (table === "groups") fresh.blocks = study.read(["groups", 0, "blocks"]);
    if (table === "groups" && study.read(["groups", 0, "parts"])) fresh.parts = study.read(["groups", 0, "parts"]);
    insertTable(study, [table], tables.length, Object.fromEntries(Object.entries(fresh).filter(([, content]) => content !== undefined)));
  };
  const isFixed = study.restrictionAt([table]) !== "";
  return html`<div class="tables">${tables.map((other, place) => html`<details key=${place} open>
      <summary>${other.name ?? other.reason ?? place + 1}</summary>
      <${TableForm} study=${study} path=${[table, place]} table=${table} essential=${["parts", "blocks", "order", "allocation_ratio"].filter((name) => name in other || name === "allocation_ratio")} />
      ${!isFixed && html`<${TableButtons} study=${study} path=${[table]} place=${place} count=${tables.length} name=${other.name ?? place + 1} />`}
    </details>`)}
    ${tables.length === 0 && html`<p class="quiet">None yet.</p>`}
    ${isFixed ? html`<p class="fixed">Fixed: ${study.restrictionAt([table])}</p>` : html`<button type="button" onClick=${add}>Add ${table === "exclusions" ? "a rule" : `a ${list.name}`}</button>`}
  </div>`;
}

/** The file as text: what the page writes, and what can be edited beside it. @param {{ study: OpenStudy }} properties */
export function SourceView({ study }) {
  const document = /** @type {Document} */ (study.document);
  const [typed, setTyped] = useState(/** @type {string | null} */ (null));
  const save = async () => {
    if (typed !== null && await study.edit([{ op: "replace_text", path: [], value: typed }])) setTyped(null);
  };
  return html`<section class="source" aria-label="File"><p class="quiet"><code>${document.key}</code> is the study: everything on these pages is read from it
      and written to it, comments and spacing stay. You can edit it here, or in any editor beside this page.</p>
    <textarea class="code" aria-label=${`Text of ${document.key}`} spellcheck="false" rows="30" value=${typed ?? document.text}
      onInput=${(/** @type {any} */ event) => setTyped(event.target.value)}></textarea>
    <div class="buttons"><button type="button" class="main" disabled=${typed === null} onClick=${save}>Save the file</button>
      <button type="button" disabled=${typed === null} onClick=${() => setTyped(null)}>Discard</button></div>
    ${document.read_only.length > 0 && html`<h3>What only the file shows</h3><ul>${document.read_only.map((note) => html`<li>line ${note.line}: ${note.message}</li>`)}</ul>`}
  </section>`;
}
