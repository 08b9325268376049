// What a field keeps of a text, in what language a page says that it is not connected, and when a page is translated.

import assert from "node:assert/strict";
import { test } from "node:test";

import { findTranslation } from "../../../minihuman/web/page/appearance.js";
import { cleanText, isSessionKey } from "../../../minihuman/web/page/field.js";
import { chooseNotice } from "../../../minihuman/web/page/unreachable.js";

test("joiners, no-break spaces, blanks and lines stay; control characters and halves of letters do not", () => {
  assert.equal(cleanText(" a\u200c\u200d\u00a0b\tc\n\u202e "), " a\u200c\u200d\u00a0b\tc\n\u202e ");
  assert.equal(cleanText("a\0\x1b\x7f\ud83d"), "a\ufffd");
  assert.equal(cleanText("\u{1f680}"), "\u{1f680}");
});

test("Enter and Page up are the session's in a line, and the field's in a long text", () => {
  for (const key of ["enter", "page_up"]) {
    assert.equal(isSessionKey(key, false), true);
    assert.equal(isSessionKey(key, true), false);
  }
});

test("a page says what is wrong in the first language of the browser's that it has, else in English", () => {
  const texts = { en: "Code {code}", ar: "\u0631\u0645\u0632 {code}" };
  assert.deepEqual(chooseNotice(texts, ["fi", "ar-EG", "en"], "N-0-H"), { language: "ar", rtl: true, text: "\u0631\u0645\u0632 N-0-H" });
  assert.equal(chooseNotice(texts, ["fi"], "N-0-X")?.text, "Code N-0-X");
  assert.equal(chooseNotice({}, ["en"], ""), null);
});

test("a page is translated where it has another language than its own, or a browser's mark", () => {
  const page = (lang, ...names) => ({ lang, classList: { contains: (name) => names.includes(name) } });
  assert.equal(findTranslation(page("en"), "en"), "");
  assert.equal(findTranslation(page("de"), "en"), "de");
  assert.equal(findTranslation(page("en", "translated-rtl"), "en"), "unknown");
  assert.equal(findTranslation(page("en"), ""), "");
});
