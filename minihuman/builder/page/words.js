// Words of the page: names of fields as a person reads them, and sentences of the schema with their code marked.
import { html } from "./vendor/preact.js";

/** @param {string} name a field's name, such as "max_steps" @returns {string} "Max steps" */
export function spellName(name) {
  const stripped = name.replaceAll("_", " ").replace(/ (ms|s|px|min)$/, "");
  const words = stripped === "feedback" && stripped !== name ? "feedback time" : stripped; // the text has this name
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** @param {string} sentence of the schema, in Markdown @returns {string} a whole sentence, without links */
function completeSentence(sentence) {
  const plain = sentence.replace(/ ?\((?:see )?\[[^\]]+\]\([^)]*\)\)/g, "").replace(/\[([^\]]+)\]\([^)]*\)/g, "$1").trim();
  const begun = plain.charAt(0).toUpperCase() + plain.slice(1);
  return /[.!?]$/.test(begun) || !begun ? begun : `${begun}.`;
}

/** @param {string} sentence in Markdown: code and links @returns {unknown[]} nodes; a link becomes its text */
export function renderSentence(sentence) {
  return completeSentence(sentence).split("`").map((text, place) => (place % 2 ? html`<code>${text}</code>` : text));
}

/** @param {string} sentence @returns {string} the sentence without marks */
export const stripMarks = (sentence) => completeSentence(sentence).replaceAll("`", "");

/** @param {unknown} content @returns {string} a value as a person writes it */
export function formatContent(content) {
  if (content === null || content === undefined || content === "") return "none";
  if (content === true) return "yes";
  if (content === false) return "no";
  if (Array.isArray(content)) return content.length ? content.map(formatContent).join(", ") : "none";
  if (typeof content === "object") {
    const pairs = Object.entries(content).map(([name, part]) => `${name}: ${formatContent(part)}`);
    return pairs.length ? pairs.join(", ") : "none";
  }
  return String(content);
}

/** @param {[number, number] | null} minutes */
export function formatMinutes(minutes) {
  if (!minutes) return "";
  const [least, most] = minutes.map((count) => Math.max(1, Math.round(count)));
  return least === most ? `about ${most} min` : `${least}–${most} min`;
}

/** @param {number} count @param {string} noun */
export const countNoun = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;

/** @param {string} text @param {string[]} taken @returns {string} a valid name that is not taken */
export function makeName(text, taken) {
  const base = text.toLowerCase().replace(/[^a-z0-9_]+/g, "-").replace(/^[-_]+|[-_]+$/g, "") || "part";
  if (!taken.includes(base)) return base;
  let number = 2;
  while (taken.includes(`${base}-${number}`)) number += 1;
  return `${base}-${number}`;
}

const KIND_WORDS = /** @type {Record<string, string>} */ ({
  page: "Text", questions: "Questions", play: "World", order: "Order", activity: "Activity", trials: "Trials", team: "Team",
  takeover: "With an agent", rating: "Rating", preferences: "Comparison", correction: "Correction",
  keyboard_check: "Keyboard check",
});

const KIND_ABOUT = /** @type {Record<string, string>} */ ({
  page: "A text to read: instructions, a pause, the last words.",
  consent: "A text to agree to, with purpose, storage, rights and contact to fill in.",
  questions: "A questionnaire, or a quiz with right answers that leads back.",
  play: "Episodes in a world, seen from above or in first person.",
  order: "Parts that come shuffled or in a Latin square.",
  trials: "One stimulus after the other: Stroop, go/no-go, n-back.",
  team: "Two or more people, or people and agents, in one world.",
  takeover: "An agent plays, and the person may take over.",
  rating: "An agent plays, and the person says how well.",
  preferences: "Two films of an agent: which is better?",
  correction: "The person corrects an agent's steps afterwards.",
});

/** @param {{ kind: string, summary: string }} kind @returns {string} what a kind of part is, in a sentence */
export const describeKind = ({ kind, summary }) => KIND_ABOUT[kind] ?? stripMarks(summary);

/** @param {string} kind @returns {string} */
export const nameKind = (kind) => KIND_WORDS[kind] ?? spellName(kind);
