// A dialog in front of the page: takes the focus, ends with Escape, and gives the focus back.
import { html, useEffect, useRef } from "./vendor/preact.js";

/** @param {{ title: string, close: () => void, children?: unknown, isWide?: boolean }} properties */
export function Dialog({ title, close, children, isWide = false }) {
  const dialog = useRef(/** @type {any} */ (null));
  useEffect(() => {
    const before = /** @type {HTMLElement | null} */ (document.activeElement);
    dialog.current.showModal();
    return () => before?.focus();
  }, []);
  const onClick = (/** @type {any} */ event) => event.target === dialog.current && close();
  return html`<dialog ref=${dialog} class=${isWide ? "wide" : ""} aria-label=${title} onCancel=${close} onClick=${onClick}>
    <div class="dialog-box"><header><h2>${title}</h2>
      <button type="button" class="icon" aria-label="Close" onClick=${close}>×</button></header>${children}</div>
  </dialog>`;
}
