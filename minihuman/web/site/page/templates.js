// Texts of an episode's feedback, filled in as Python's `str.format` fills them in.

const FIELD = /\{\{|\}\}|\{(steps|reward)(?::\.?(\d+)f)?\}/g;
const SIGNED = /(?<![\p{L}\p{N}_])[-+\u2212](?=\d)/gu;

/** A number with so many decimals, halves to even, as Python rounds. @param {number} x @param {number} decimals */
export function formatFixed(x, decimals) {
  const scaled = x * 2 ** (decimals + 1);
  const isHalf = Number.isInteger(scaled) && Math.abs(scaled % 2) === 1 && decimals > 0 || (decimals === 0 && Math.abs(x % 1) === 0.5);
  if (!isHalf) return x.toFixed(decimals);
  const down = Math.floor(x * 10 ** decimals), even = down % 2 === 0 ? down : down + 1;
  return (even / 10 ** decimals).toFixed(decimals);
}

/** A number as Python writes it. @param {number} x */
const formatNumber = (x) => (Number.isInteger(x) ? x.toFixed(1) : String(x));

/** @param {string} template @param {{ steps: number, reward: number }} episode @param {boolean} rtl */
export function fillTemplate(template, { steps, reward }, rtl) {
  const text = template.replaceAll(FIELD, (whole, field, decimals) => {
    if (!field) return whole[0];
    if (field === "steps") return String(steps);
    return decimals === undefined ? formatNumber(reward) : formatFixed(reward, Number(decimals));
  }).trim();
  const [first = ""] = text, capitalised = first.toUpperCase() + text.slice(first.length);
  return rtl ? capitalised.replaceAll(SIGNED, "\u200e$&") : capitalised;
}
