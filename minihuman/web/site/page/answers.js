// What a typed answer is judged to be, by the rules of Python's `judge_text` (minihuman/activities/questions).

/**
 * @typedef {{ is_number: boolean, language: string | null, longest: number, required: boolean, whole: boolean,
 * minimum: number, maximum: number }} FieldRules
 */

// what Python's `str.strip` takes away
const BLANKS = "[\\t-\\r\\x1c- \\x85\\xa0\\u1680\\u2000-\\u200a\\u2028\\u2029\\u202f\\u205f\\u3000]";
const ENDS = new RegExp(`^${BLANKS}+|${BLANKS}+$`, "gu");
/** @type {Record<string, string>} */ const DECIMAL_MARKS = { en: ".", ja: ".", zh: ".", de: ",", es: ",", fr: "," };
/** @type {Record<string, string>} */ const SAME = { "\u2212": "-", "\uff0d": "-", "\uff0e": ".", "\uff0c": "," };
const NUMBER = /^-?(\d+(?:[.,]\d+)*|[.,]\d+)[.,]?$/;
const GROUPED = /^-?[1-9]\d{0,2}(?:[.,]\d{3})+$/;
const DIGIT = /^\p{Nd}$/u;

/** A digit of any script as one of 0 to 9: each script's ten follow one another. @param {string} letter */
function plainLetter(letter) {
  if (!DIGIT.test(letter)) return SAME[letter] ?? letter;
  let before = 0;
  const code = /** @type {number} */ (letter.codePointAt(0));
  while (DIGIT.test(String.fromCodePoint(code - before - 1))) before += 1;
  return String(before % 10);
}

/** A text as the number that it can only mean; null for none. @param {string} text @param {FieldRules} rules */
export function parseNumber(text, { language, whole }) {
  let plain = [...text.replace(ENDS, "")].map(plainLetter).join("").replaceAll("\u066c", "");
  if (plain.includes("\u066b")) {
    plain = plain.replaceAll(",", "").replaceAll("\u066b", ".");
    return /^-?\d*\.\d+$/.test(plain) ? Number(plain) : null;
  }
  if (!NUMBER.test(plain)) return null;
  const marks = plain.match(/[.,]/g) ?? [];
  if (!marks.length) return Number(plain);
  if (marks.length > 1) return parseMarks(plain, marks);
  const mark = String(marks[0]), decimal = DECIMAL_MARKS[language ?? ""];
  if (!GROUPED.test(plain)) return Number(plain.replace(mark, "."));
  if (decimal === undefined) return null;
  if (mark !== decimal) return Number(plain.replace(mark, ""));
  return whole || plain.endsWith("000") ? null : Number(plain.replace(mark, "."));
}

/** All marks separate thousands, or all but the last. @param {string} plain @param {string[]} marks */
function parseMarks(plain, marks) {
  const last = /** @type {string} */ (marks.at(-1)), other = last === "." ? "," : ".";
  if (new Set(marks).size === 1) return GROUPED.test(plain) ? Number(plain.replaceAll(last, "")) : null;
  if (!new RegExp(`^-?\\d{1,3}(?:\\${other}\\d{3})+\\${last}\\d*$`).test(plain)) return null;
  return Number(plain.replaceAll(other, "").replace(last, "."));
}

/** @param {FieldRules} rules @param {string} text @returns {string} "empty", "fine", or the note that is shown for it */
export function judgeText(rules, text) {
  if (!text) return "empty";
  const isBlank = !text.replace(ENDS, "");
  if (!rules.is_number || isBlank) {
    if ([...text].length > rules.longest) return "note.too_long";
    return isBlank && rules.required ? "note.required" : "fine";
  }
  const number = parseNumber(text, rules);
  if (number === null || !Number.isFinite(number) || (rules.whole && !Number.isInteger(number))) {
    return rules.whole ? "note.whole_number" : "note.number";
  }
  return number >= rules.minimum && number <= rules.maximum ? "fine" : "note.range";
}
