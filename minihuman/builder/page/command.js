// The command that does what a button does, to be copied.
import { html } from "./vendor/preact.js";

/** @param {string} word @returns {string} the word as a shell reads it */
export const quoteWord = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\"'\"'")}'`);

/** @param {{ about: string, line: string }} properties */
export function Command({ about, line }) {
  return html`<p class="command"><span>${about}:</span> <code>${line}</code>
    <button type="button" class="small" onClick=${() => navigator.clipboard.writeText(line)}>Copy the command</button></p>`;
}
