// What a page says that no transport welcomes, in the browser's language: the server's words have not come yet.

const ADDRESS = "/static/unreachable.json";
const REPORT_ADDRESS = "/unwelcomed"; // the server counts such pages, where a plain request reaches it
const AFTER_MS = 8000; // since the page began to load
const RIGHT_TO_LEFT = new Set(["ar", "he"]);

/** @typedef {{ language: string, rtl: boolean, text: string }} Notice */

/**
 * The notice in the first of a browser's languages that there is one in, else in English.
 * @param {Record<string, string>} texts by language @param {readonly string[]} languages @param {string} code
 * @returns {Notice | null} null where there are no texts
 */
export function chooseNotice(texts, languages, code) {
  const known = languages.map((name) => name.toLowerCase().split("-")[0]).find((name) => name in texts);
  const language = known ?? "en";
  if (!(language in texts)) return null;
  return { language, rtl: RIGHT_TO_LEFT.has(language), text: texts[language].replace("{code}", code) };
}

/**
 * Say so once, if the page is still without a welcome by then. The texts are fetched at once: later nothing may get through.
 * @param {() => boolean} isWelcomed @param {() => string} findCode @param {(notice: Notice) => void} show
 */
export async function watchForWelcome(isWelcomed, findCode, show) {
  /** @type {Record<string, string>} */ let texts = {};
  setTimeout(() => {
    const notice = isWelcomed() ? null : chooseNotice(texts, navigator.languages, findCode());
    if (!notice) return;
    show(notice);
    fetch(REPORT_ADDRESS, { cache: "no-store" }).catch(() => {});
  }, Math.max(0, AFTER_MS - performance.now()));
  try { texts = await (await fetch(ADDRESS)).json(); } catch { /* the page stays as it is */ }
}
