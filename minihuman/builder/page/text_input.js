// A text or a number that is saved when its field is left, or with Enter: what is typed stays while the page is drawn anew.
import { html, useState } from "./vendor/preact.js";

/**
 * @param {{ value: string | number, save: (text: string) => void, rows?: number, [attribute: string]: unknown }} properties
 *   save: is called with a text that differs; rows: of a text of several lines
 */
export function TextInput({ value, save, rows, ...attributes }) {
  const [typed, setTyped] = useState(/** @type {string | null} */ (null));
  const shared = {
    type: "text",
    ...attributes,
    value: typed ?? value,
    onInput: (/** @type {any} */ event) => setTyped(event.target.value),
    onBlur: () => setTyped(null), // after the change, if there is one
    onChange: (/** @type {any} */ event) => {
      setTyped(null);
      if (event.target.value !== String(value)) save(event.target.value);
    },
  };
  if (!rows) return html`<input ...${shared} />`;
  return html`<textarea ...${shared} type=${undefined} rows=${rows}></textarea>`;
}
