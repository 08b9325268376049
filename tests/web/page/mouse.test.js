// The mouse as axes: whole pixels while it is captured, and nothing at other times.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { MouseLook } from "../../../minihuman/web/page/mouse.js";

const PLAY = { kind: "play", axes: ["mouse_x"] };
let on, main, line, sent, isBehind, asked, look, frames;

class Canvas {}

beforeEach(() => {
  on = {};
  sent = [];
  frames = [];
  globalThis.requestAnimationFrame = (then) => frames.push(then);
  isBehind = false;
  asked = 0;
  line = { textContent: "" };
  main = { querySelector: () => line, requestPointerLock: () => { asked += 1; return Promise.reject(new Error("too soon")); } };
  globalThis.HTMLCanvasElement = Canvas;
  globalThis.matchMedia = () => ({ matches: true });
  globalThis.addEventListener = (kind, then) => { on[kind] = then; };
  globalThis.document = {
    pointerLockElement: null,
    addEventListener: (kind, then) => { on[kind] = then; },
    exitPointerLock: () => capture(null),
  };
  look = new MouseLook(main, ({ axis, pixels }, ms) => sent.push(`${axis} ${pixels} ${ms}`), () => isBehind);
  look.texts = { mouse_look: "Click." };
});

function capture(element) {
  document.pointerLockElement = element;
  on.pointerlockchange();
}

const move = (movementX, timeStamp) => on.mousemove({ movementX, movementY: 5, timeStamp });

test("motion is told while the mouse is captured, of the axes that the screen is steered by", () => {
  look.show(PLAY);
  look.say();
  assert.equal(line.textContent, "Click.");
  move(3, 100);
  on.click({ target: {} });
  assert.equal(asked, 0);
  on.click({ target: new Canvas() });
  assert.equal(asked, 1);
  capture(main);
  assert.equal(line.textContent, "");
  move(3, 110);
  move(-0.6, 130);
  move(-0.6, 150); // with what was left over
  move(9000, 170);
  assert.deepEqual(sent, ["mouse_x 3 110", "mouse_x -1 150", "mouse_x 4096 170"]);
});

test("of a thousand motions a second some seventy messages come, and no pixel is lost", () => {
  look.show(PLAY);
  capture(main);
  for (let ms = 0; ms < 1000; ms++) {
    move(1, ms);
    if (ms % 7 === 6) for (const then of frames.splice(0)) then(ms); // a display of 144 Hz
  }
  for (let ms = 1000; frames.length; ms += 7) for (const then of frames.splice(0)) then(ms);
  assert.equal(sent.map((line) => Number(line.split(" ")[1])).reduce((sum, px) => sum + px), 1000);
  assert.ok(sent.length <= 70, `${sent.length} messages`);
});

test("motion waits for the step that is due, and adds up until then", () => {
  look.show(PLAY);
  capture(main);
  isBehind = true;
  move(3, 110);
  move(4, 120);
  assert.deepEqual(sent, []);
  look.sendMotion();
  look.sendMotion();
  assert.deepEqual(sent, ["mouse_x 7 120"]);
});

test("another screen gives the mouse back and play takes it again, unless Escape gave it back", () => {
  look.show(PLAY);
  capture(main);
  look.show({ kind: "text" });
  assert.equal(document.pointerLockElement, null);
  look.show(PLAY);
  assert.equal(asked, 1);
  capture(main);
  capture(null); // Escape
  assert.equal(line.textContent, "Click.");
  look.show({ kind: "text" });
  look.show(PLAY);
  assert.equal(asked, 1);
});
