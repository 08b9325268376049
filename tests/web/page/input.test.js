// Keys as the session hears of them: by place, once, with our own repetition.

import assert from "node:assert/strict";
import { beforeEach, mock, test } from "node:test";

import { Keyboard } from "../../../minihuman/web/page/input.js";

const state = { active: true, typing: false, scrollable: false };
let heard = [];
let target = new EventTarget();
let keyboard;

beforeEach(() => {
  Object.assign(state, { active: true, typing: false, scrollable: false, field: null });
  heard = [];
  target = new EventTarget();
  keyboard = new Keyboard(target, {
    isActive: () => state.active,
    isTyping: () => state.typing,
    isChatting: () => state.chatting ?? false,
    nativeField: () => state.field ?? null,
    isScrollable: () => state.scrollable,
    now: () => 0,
    timeOf: (ms) => ms,
    press: (key, symbol, _stamp, _trusted, isRepeat, cause) => {
      heard.push(`${isRepeat ? "repeat" : cause === "finger" ? "press" : cause} ${key} ${symbol}`.trim());
    },
    release: (key, _stamp, _trusted, cause) => heard.push(cause === "finger" ? `release ${key}` : `${cause} ${key}`),
  });
  keyboard.codes = { KeyA: "a", ArrowUp: "up", MetaLeft: "meta", Enter: "enter" };
  mock.timers.reset();
  mock.timers.enable({ apis: ["setTimeout"] });
});

/** Whether the browser keeps the key. */
function send(type, code, key, fields = {}) {
  const event = Object.assign(new Event(type, { cancelable: true }), { code, key, getModifierState: () => false, ...fields });
  return target.dispatchEvent(event);
}

test("a key is pressed and released once, by its place", () => {
  assert.equal(send("keydown", "KeyA", "q"), false);
  send("keydown", "KeyA", "q", { repeat: true });
  send("keyup", "KeyA", "q");
  send("keyup", "KeyA", "q");
  assert.deepEqual(heard, ["press a q", "release a"]);
});

test("a key without a name is called by its code", () => {
  send("keydown", "Lang<1>", "Lang1");
  assert.deepEqual(heard, ["press code_Lang1"]);
});

test("a held key repeats after 500 ms, every 33 ms, until it comes up", () => {
  send("keydown", "KeyA", "a");
  mock.timers.tick(499);
  assert.equal(heard.length, 1);
  for (const ms of [1, 33, 33]) mock.timers.tick(ms);
  send("keyup", "KeyA", "a");
  mock.timers.tick(1000);
  assert.deepEqual(heard, ["press a a", "repeat a a", "repeat a a", "repeat a a", "release a"]);
});

test("a window that loses the focus holds no key down, and says that no finger left it", () => {
  send("keydown", "KeyA", "a");
  keyboard.releaseAll();
  mock.timers.tick(1000);
  assert.deepEqual(heard, ["press a a", "focus_loss a"]);
});

test("a key that was down before the focus is no press, and repeats nothing", () => {
  send("keydown", "KeyA", "a", { repeat: true });
  send("keydown", "KeyA", "a", { repeat: true });
  mock.timers.tick(1000);
  send("keyup", "KeyA", "a");
  send("keydown", "KeyA", "a");
  assert.deepEqual(heard, ["held_before_focus a a", "release a", "press a a"]);
});

test("a key of which only the release is seen was down before the focus", () => {
  send("keyup", "Enter", "Enter");
  assert.deepEqual(heard, ["held_before_focus enter", "release enter"]);
});

test("a letter beside Ctrl, Alt or Meta is a shortcut, beside AltGr it is a key", () => {
  send("keydown", "KeyA", "a", { ctrlKey: true });
  send("keyup", "KeyA", "a");
  send("keydown", "KeyA", "@", { ctrlKey: true, altKey: true, getModifierState: (name) => name === "AltGraph" });
  assert.deepEqual(heard, ["shortcut a a", "release a", "press a @"]);
});

test("when Command comes up, so does every key beside it", () => {
  send("keydown", "MetaLeft", "Meta", { metaKey: true });
  send("keydown", "KeyA", "a", { metaKey: true });
  send("keyup", "MetaLeft", "Meta");
  assert.deepEqual(heard.slice(2), ["release meta", "release a"]);
});

test("the browser keeps shortcuts, reloading, scrolling and letters that are typed, and nothing else", () => {
  assert.equal(send("keydown", "KeyA", "a", { ctrlKey: true }), true);
  assert.equal(send("keydown", "F5", "F5"), true);
  assert.equal(send("keydown", "ArrowUp", "ArrowUp"), false);
  state.scrollable = true;
  assert.equal(send("keydown", "ArrowUp", "ArrowUp"), true);
  state.typing = true;
  assert.equal(send("keydown", "KeyB", "b"), true);
  assert.equal(send("keydown", "Enter", "Enter"), false);
});

test("keys of an input method are the input method's", () => {
  state.typing = true;
  assert.equal(send("keydown", "Enter", "Enter", { keyCode: 229 }), true);
  assert.equal(send("keydown", "KeyA", "a", { isComposing: true }), true);
  assert.deepEqual(heard, []);
});

test("nothing is heard before the session's time is known, or after the end", () => {
  state.active = false;
  assert.equal(send("keydown", "KeyA", "a"), true);
  state.active = true;
  send("keyup", "KeyA", "a");
  assert.deepEqual(heard, []);
});

for (const isLong of [false, true]) {
  test(`of the keys in a field of ${isLong ? "several lines" : "one line"}, the session hears of those that are meant for it`, () => {
    let counted = 0;
    state.typing = true;
    state.field = { item: { long: isLong }, countKey: () => { counted += 1; } };
    keyboard.codes = { KeyA: "a", Enter: "enter", Tab: "tab", Escape: "escape" };
    for (const [code, key, fields] of [["KeyA", "a", {}], ["KeyV", "v", { ctrlKey: true }], ["Enter", "Enter", { isComposing: true }],
      ["Enter", "Enter", {}], ["Tab", "Tab", {}], ["Escape", "Escape", {}]]) {
      send("keydown", code, key, fields);
      send("keyup", code, key, fields);
    }
    const ends = isLong ? [] : ["press enter", "release enter"];
    assert.deepEqual(heard, [...ends, "press tab", "release tab", "press escape", "release escape"]);
    assert.equal(counted, 0, "a script's keys do not count");
  });
}

const FIREFOX = "Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0";

/** A keyboard as Firefox under X11 has it, with the focus since 0 ms. */
function openFirefox() {
  target = new EventTarget();
  const { listener, codes } = keyboard;
  keyboard = new Keyboard(target, listener, FIREFOX);
  keyboard.codes = codes;
  keyboard.come(0);
}

function sendAt(ms, type, fields = {}) {
  const event = Object.assign(new Event(type), { code: "KeyA", key: "a", getModifierState: () => false, ...fields });
  Object.defineProperty(event, "timeStamp", { value: ms });
  target.dispatchEvent(event);
}

test("Firefox's press of a key that was down before the focus came is none: it repeats at once", () => {
  openFirefox();
  sendAt(300, "keydown");
  assert.deepEqual(heard, []);
  sendAt(340, "keydown", { repeat: true });
  sendAt(380, "keydown", { repeat: true });
  sendAt(400, "keyup");
  assert.deepEqual(heard, ["held_before_focus a a", "release a"]);
});

test("a finger's press soon after the focus counts as soon as the key comes up, waits, or gives way to another", () => {
  openFirefox();
  sendAt(300, "keydown");
  sendAt(320, "keyup");
  assert.deepEqual(heard, ["press a a", "release a"]);
  keyboard.releaseAll();
  keyboard.come(1000);
  sendAt(1300, "keydown");
  mock.timers.tick(149);
  assert.equal(heard.length, 2);
  mock.timers.tick(1);
  assert.equal(heard[2], "press a a");
  sendAt(1400, "keyup");
  keyboard.releaseAll();
  keyboard.come(2000);
  sendAt(2100, "keydown");
  sendAt(2120, "keydown", { code: "Enter", key: "Enter" });
  mock.timers.tick(150);
  assert.deepEqual(heard.slice(-2), ["press a a", "press enter"]);
});

test("later than a second after the focus, and in other browsers, nothing is doubted", () => {
  sendAt(300, "keydown");
  assert.deepEqual(heard, ["press a a"]);
  openFirefox();
  sendAt(1001, "keydown");
  assert.deepEqual(heard, ["press a a", "press a a"]);
});
