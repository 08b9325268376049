// What only the laboratory knows of a consent, as fields of their own; and the one-page record of processing made of the file.
/** @import { FieldPath, OpenStudy } from "./open_study.js" */
import { html } from "./vendor/preact.js";
import { countNoun } from "./words.js";

const PLACEHOLDER = /\[([^\][\n]+)\]/g; // what a template leaves open

/** @param {string} text @returns {string[]} what a text leaves open, in order */
export const listPlaceholders = (text) => Array.from(text.matchAll(PLACEHOLDER), (match) => match[1]);

/** @param {string} text @param {string} label @param {string} words @returns {string} the text with the words in the first place of that label */
export const fillPlaceholder = (text, label, words) => text.replace(`[${label}]`, () => words);

/** The open places of a text as fields. @param {{ study: OpenStudy, path: FieldPath }} properties */
export function OpenPlaces({ study, path }) {
  const labels = listPlaceholders(String(study.read(path) ?? ""));
  if (!labels.length || study.restrictionAt(path)) return null;
  const fill = (/** @type {string} */ label, /** @type {string} */ words) => words.trim() && study.edit([
    { op: "set", path, value: fillPlaceholder(String(study.read(path)), label, words.trim()) }]);
  return html`<section class="open-places" aria-label="To fill in"><h3>To fill in</h3>
    <p class="quiet">What only you know. It takes the place of the brackets in the text below.</p>
    ${labels.map((label) => html`<label class="block" key=${label} dir="auto">${label.charAt(0).toUpperCase() + label.slice(1)}
      <input type="text" dir="auto" onChange=${(/** @type {any} */ event) => fill(label, event.target.value)} /></label>`)}</section>`;
}

/** @param {any} tree of a protocol @returns {string} the text that participants agree to; "" if there is none */
export function findConsent(tree) {
  const pages = (tree.pages ?? []).filter((/** @type {any} */ page) => page.asks_consent);
  return [...pages.map((/** @type {any} */ page) => page.text), tree.study?.consent].filter(Boolean).join("\n\n").trim();
}

/** @param {any} tree of a protocol @returns {string[]} the kinds of data that sessions record */
export function listRecordedData(tree) {
  const items = (tree.questions ?? []).flatMap((/** @type {any} */ table) => table.items ?? []);
  const forms = (tree.questions ?? []).map((/** @type {any} */ table) => table.form).filter(Boolean);
  const platforms = tree.web?.recruitment_platforms ?? [];
  const hasChat = (tree.blocks ?? []).some((/** @type {any} */ block) => block.team?.chat);
  return [
    "Keys, buttons and pointer movements with their times; each step of each episode or trial, and what was on the screen.",
    ...(items.length ? [`Answers to ${countNoun(items.length, "question")}: ${items.map((/** @type {any} */ item) => item.ask || item.name).join(" · ")}`] : []),
    ...(forms.length ? [`Answers to standard questionnaires: ${forms.join(", ")}`] : []),
    "An estimate, from the times of key presses, of whether a person or a program pressed the keys.",
    ...(hasChat ? ["Messages between the people of a team."] : []),
    ...(platforms.length ? [`The id of the recruitment platform (${platforms.join(", ")}), in a file of its own beside the data; no log contains it.`] : []),
    ...(tree.bonus ? ["Points and payment, under the participant's code."] : []),
  ];
}

/** @param {any} tree of a protocol @returns {[string, string[]][]} the rows of the record: what it says, line by line; no line where the file does not say it */
export function buildProcessingRecord(tree) {
  const about = tree.about ?? {};
  const study = tree.study ?? {};
  const authors = (about.authors ?? []).map((/** @type {any} */ author) => Object.values(author).filter((part) => typeof part === "string").join(", "));
  const consent = findConsent(tree);
  const sessions = tree.sessions?.length ?? 1;
  const platforms = tree.web?.recruitment_platforms ?? [];
  return [
    ["Study", [[about.title, study.name, study.version && `version ${study.version}`].filter(Boolean).join(", ")]],
    ["Responsible", [[about.institution, about.department, about.address].filter(Boolean).join(", "), ...authors].filter(Boolean)],
    ["Purpose", [tree.design?.question, about.description].filter(Boolean)],
    ["Legal basis", consent ? ["Consent of the participant, before anything is recorded (GDPR article 6(1)(a))."] : []],
    ["Whose data", [`${countNoun(study.participants ?? 100, "participant")}, ${countNoun((tree.groups ?? []).length, "group")}, ${countNoun(sessions, "session")} each`,
      ...(platforms.length ? [`recruited by ${platforms.join(", ")}`] : [])]],
    ["Which data", listRecordedData(tree)],
    ["Recipients, place and duration of storage", listPlaceholders(consent).length || !consent ? [] : ["As the participants read it, below."]],
    ["Measures", ["Data lie under a code; no log contains a name, an address or a user agent. Each log is proven step by step; a change is found by minihuman verify."]],
    ["Rights", ["Access: minihuman replay and export. Erasure: minihuman withdraw CODE --erase, which also removes the participant from later tables, reports and exports."]],
    ["Ethics approval", about.ethics_approvals ?? []],
    ["Funding", about.funding ?? []],
  ];
}

/** @param {{ study: OpenStudy }} properties */
export function ProcessingRecord({ study }) {
  const tree = /** @type {any} */ (study.document?.tree ?? {});
  const rows = buildProcessingRecord(tree);
  const consent = findConsent(tree);
  const missing = [...rows.filter(([, lines]) => !lines.length).map(([name]) => name), ...listPlaceholders(consent)];
  return html`<div class="processing"><div class="buttons"><button type="button" class="main" onClick=${() => print()}>Print or save as PDF</button></div>
    ${missing.length > 0 && html`<p class="notice screen-only" role="status">Not said yet: ${missing.join("; ")}. Say it in the consent, and under About and Question and design.</p>`}
    <table><caption>Record of processing activities (GDPR article 30)</caption><tbody>${rows.map(([name, lines]) => html`<tr key=${name}><th scope="row">${name}</th>
      <td dir="auto">${lines.length ? lines.map((line) => html`<p>${line}</p>`) : html`<p class="quiet">[not said]</p>`}</td></tr>`)}
      <tr><th scope="row">As participants read it</th><td class="as-read" dir="auto">${consent || html`<span class="quiet">[no consent is asked for]</span>`}</td></tr></tbody></table></div>`;
}
