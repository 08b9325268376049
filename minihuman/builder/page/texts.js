// Every text that participants read, on one page, beside the texts of the study that it translates.
/** @import { Document, Edit, StudyCard } from "./messages" */
/** @import { FieldPath, OpenStudy } from "./open_study.js" */
import { html, useEffect, useState } from "./vendor/preact.js";
import { LANGUAGES } from "./preview.js";
import { readAt } from "./edits.js";
import { formatPath } from "./open_study.js";
import { editStudy, listStudies, makeStudy, readStudy } from "./requests.js";
import { TextInput } from "./text_input.js";
import { spellName } from "./words.js";

const TEXT_FIELDS = /** @type {Record<string, string[]>} */ ({
  study: ["consent", "closing"],
  pages: ["title", "text"],
  questions: ["title", "wrong_answer_text"],
  items: ["ask", "low", "high", "options", "statements"],
  blocks: ["title", "mission", "instructions", "feedback", "rest_text"],
});

/** @typedef {{ path: FieldPath, part: string, field: string, text: string }} StudyText */

/** @param {any} tree @returns {StudyText[]} the texts of a study, in the order of its file */
export function listTexts(tree) {
  /** @type {StudyText[]} */
  const texts = [];
  /** @param {any} table @param {FieldPath} path @param {string} part @param {string[]} fields */
  const collect = (table, path, part, fields) => {
    for (const field of fields) collectText(texts, table?.[field], [...path, field], part, field);
  };
  collect(tree.study, ["study"], "Study", TEXT_FIELDS.study);
  for (const kind of ["pages", "blocks", "questions"]) {
    (tree[kind] ?? []).forEach((/** @type {any} */ table, /** @type {number} */ place) => {
      collect(table, [kind, place], table.name, TEXT_FIELDS[kind]);
      (table.items ?? []).forEach((/** @type {any} */ item, /** @type {number} */ number) =>
        collect(item, [kind, place, "items", number], `${table.name} · ${item.name}`, TEXT_FIELDS.items));
    });
  }
  return texts;
}

/** @param {StudyText[]} texts @param {any} content @param {FieldPath} path @param {string} part @param {string} field */
function collectText(texts, content, path, part, field) {
  if (typeof content === "string" && content.trim()) texts.push({ path, part, field, text: content });
  if (!content || typeof content !== "object") return;
  for (const [name, text] of Object.entries(content)) {
    const step = Array.isArray(content) ? Number(name) : name;
    if (typeof text === "string") texts.push({ path: [...path, step], part, field: `${field} ${Array.isArray(content) ? Number(name) + 1 : name}`, text });
  }
}

/** @param {StudyCard[]} cards @param {Document} study @returns {StudyCard[]} studies with the same parts in other languages */
export function findTranslations(cards, study) {
  const names = (/** @type {{ name: string }[]} */ parts) => parts.map((part) => part.name).toSorted().join();
  const own = names(study.parts);
  return cards.filter((card) => card.key !== study.key && card.has_protocol && !card.problem && names(card.parts) === own);
}

/** @param {{ study: OpenStudy, open: (key: string) => void, languages: string[] }} properties */
export function Texts({ study, open, languages }) {
  const [cards, setCards] = useState(/** @type {StudyCard[]} */ ([]));
  const [original, setOriginal] = useState(/** @type {Document | null} */ (null));
  const document = /** @type {Document} */ (study.document);
  const tree = /** @type {any} */ (document.tree);
  const language = tree.study?.language ?? "en";
  useEffect(() => { listStudies().then((answer) => setCards(answer.studies), () => {}); }, [document.version]);
  const translations = findTranslations(cards, document).filter((card) => card.language !== language);
  const compare = async (/** @type {string} */ key) => setOriginal(key ? await readStudy(key) : null);
  const texts = listTexts(tree);
  const same = original ? texts.filter(({ path, text }) => readAt(original.tree, path) === text).length : 0;
  return html`<section class="texts" aria-label="Texts"><header>
      <div class="segments" role="group" aria-label="Language">
        <button type="button" aria-pressed="true">${nameLanguage(language)}</button>
        ${translations.map((card) => html`<button type="button" aria-pressed="false" key=${card.key} onClick=${() => open(card.key)}>${nameLanguage(card.language)}</button>`)}</div>
      <${NewLanguage} study=${study} taken=${[language, ...translations.map((card) => card.language)]} open=${open} languages=${languages} />
      ${translations.length > 0 && html`<label>Beside <select onChange=${(/** @type {any} */ event) => compare(event.target.value)}>
        <option value="">no other language</option>${translations.map((card) => html`<option value=${card.key}>${nameLanguage(card.language)}</option>`)}</select></label>`}
      ${original && html`<p role="status" class=${same ? "mistake" : "quiet"}>${same ? `${same} of ${texts.length} texts are not translated yet` : "Every text is translated"}</p>`}
    </header>
    <p class="quiet">The words of minihuman itself (buttons, pauses, “Ready?”) come in the study's language by themselves. Braces such as
      <code>{steps}</code> are filled in and stay as they are.</p>
    ${texts.length === 0 && html`<p class="quiet">No part has a text yet.</p>`}
    ${texts.map((text) => html`<${TextRow} key=${formatPath(text.path)} study=${study} text=${text} original=${original} />`)}
  </section>`;
}

/** @param {string} code @returns {string} */
const nameLanguage = (code) => /** @type {any} */ (LANGUAGES)[code] ?? code;

/** @param {{ study: OpenStudy, text: StudyText, original: Document | null }} properties */
function TextRow({ study, text, original }) {
  const beside = original ? readAt(original.tree, text.path) : undefined;
  const isSame = original !== null && beside === text.text;
  const id = `text-${formatPath(text.path).replace(/[^\w]+/g, "-")}`;
  const save = (/** @type {string} */ typed) => study.edit([{ op: "set", path: text.path, value: typed }]);
  const isFixed = study.restrictionAt(text.path) !== "";
  const rows = Math.min(12, Math.max(1, text.text.split("\n").length));
  return html`<div class=${`text-row ${original ? "compared" : ""} ${isSame ? "wrong" : ""}`}>
    <label for=${id}><strong>${text.part}</strong> ${spellName(text.field)}${isSame && html` <span class="badge">not translated</span>`}</label>
    ${original && html`<p class="beside" dir="auto">${beside ?? "(the other study lacks this text)"}</p>`}
    <${TextInput} id=${id} rows=${rows} dir="auto" value=${text.text} disabled=${isFixed} save=${save} />
  </div>`;
}

/** @param {{ study: OpenStudy, taken: string[], languages: string[], open: (key: string) => void }} properties */
function NewLanguage({ study, taken, languages, open }) {
  const [problem, setProblem] = useState("");
  const offered = languages.filter((code) => !taken.includes(code));
  const make = async (/** @type {any} */ event) => {
    const language = event.target.value;
    event.target.value = "";
    if (!language) return;
    const name = `${study.document?.name}-${language}`;
    /** @type {Edit[]} */
    const edits = [{ op: "set", path: ["study", "language"], value: language }];
    await makeStudy({ name, source_key: study.key }).then((copy) => editStudy(copy.key, copy.version, edits))
      .then((copy) => open(copy.key), (error) => setProblem(error.message));
  };
  return html`<label>Add a language <select onChange=${make}><option value="">choose …</option>
    ${offered.map((code) => html`<option value=${code}>${nameLanguage(code)}</option>`)}</select></label>
    ${problem && html`<p class="mistake" role="alert">${problem}</p>`}`;
}
