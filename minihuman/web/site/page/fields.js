// What is in a question's field or on its slider: the screen that shows it, and how a slider's thumb moves, by the rules
// of Python's `SliderDraft` (minihuman/activities/questions/slider).

/** @import { FieldRules } from "./answers.js" */
/** @typedef {{ n_steps: number, rtl: boolean, shown_texts: string[] }} SliderRules of a text for each step, or none */
/** @typedef {{ key: string, judgement: string, rules: FieldRules | SliderRules }} AnswerField */
/** @typedef {string | number | null} FieldAnswer a text, or the step at which a thumb is; null for no thumb */

/** @param {AnswerField["rules"]} rules @returns {rules is SliderRules} */
export const isSlider = (rules) => "n_steps" in rules;

/** A number as Python writes it in JSON, where it takes no exponent. @param {number} x */
const encodeFloat = (x) => (Number.isInteger(x) ? x.toFixed(1) : String(x));

/**
 * What a widget has of an answer, as values and as they are in the text that a screen's digest is of.
 * @param {AnswerField["rules"]} rules @param {FieldAnswer} answer
 * @returns {{ values: Record<string, any>, texts: Record<string, string> }}
 */
function describeAnswer(rules, answer) {
  if (!isSlider(rules)) {
    const text = String(answer ?? ""), caret = [...text].length;
    return { values: { text, caret }, texts: { text: JSON.stringify(text), caret: String(caret) } };
  }
  const step = typeof answer === "number" ? answer : null, position = step === null ? null : step / rules.n_steps;
  const value = step === null ? "" : rules.shown_texts[step] ?? "";
  return { values: { position, value }, texts: { position: position === null ? "null" : encodeFloat(position), value: JSON.stringify(value) } };
}

/**
 * A question's screen with an answer in it, and the text that its digest is of.
 * @param {{ looks: string, screen: any }} node @param {AnswerField["rules"]} rules @param {FieldAnswer} answer
 */
export function fillField({ looks, screen }, rules, answer) {
  const { values, texts } = describeAnswer(rules, answer);
  const filled = looks.replaceAll(/"\\u0000(\w+)\\u0000"/g, (whole, name) => texts[name] ?? whole);
  return { looks: filled, screen: { ...screen, item: { ...screen.item, ...values } } };
}

/** Where a key moves the thumb; null for a key that does not. @param {SliderRules} rules @param {FieldAnswer} step @param {string} key */
export function moveThumb({ n_steps: last, rtl }, step, key) {
  if (key === "home") return 0;
  if (key === "end") return last;
  const tenth = Math.max(1, Math.floor(last / 10)), forward = rtl ? -1 : 1;
  const by = { left: -forward, right: forward, page_up: tenth, page_down: -tenth, up: 1, down: -1 }[key];
  if (by === undefined) return null;
  return typeof step === "number" ? Math.min(last, Math.max(0, step + by)) : Math.floor(last / 2);
}

/** Where a pointer sets the thumb. @param {SliderRules} rules @param {number} along the line, 0 to 1 */
export const pointThumb = ({ n_steps: last }, along) => Math.min(last, Math.max(0, Math.floor(along * last + 0.5)));
