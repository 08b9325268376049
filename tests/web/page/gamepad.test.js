// A gamepad as the session hears of it: what is held stays true when it goes, or the focus does.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { GamepadReader } from "../../../minihuman/web/page/gamepad.js";

let frame, pad, heard, hasFocus, isBehind, now, reader;

beforeEach(() => {
  pad = {
    id: "Stub pad", mapping: "standard", connected: true, axes: [0, 0, 0, 0], timestamp: 0,
    buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })),
  };
  heard = [];
  hasFocus = true;
  isBehind = false;
  now = 100;
  globalThis.requestAnimationFrame = (then) => { frame = then; };
  Object.defineProperty(globalThis, "navigator", { configurable: true, value: { getGamepads: () => [null, pad] } });
  Object.defineProperty(globalThis, "performance", { configurable: true, value: { now: () => now } });
  const keyboard = {
    press: (name, _symbol, ms, _trusted, cause) => heard.push(`${cause === "finger" ? "press" : cause} ${name} ${ms}`),
    release: (name, ms) => heard.push(`release ${name} ${ms}`),
  };
  reader = new GamepadReader(keyboard, () => hasFocus, (what, ms) => {
    if (what.t === "axis") heard.push(`${what.axis} ${what.value} ${ms}`);
  }, () => isBehind);
  reader.want(true);
});

function read(ms) {
  now = ms;
  frame();
}

test("a gamepad that is unplugged lets go of its buttons and sticks", () => {
  pad.buttons[0] = { pressed: true, value: 1 };
  pad.axes = [-1, 0, 0, 0];
  read(110);
  heard = [];
  pad = null;
  read(120);
  read(130);
  assert.deepEqual(heard, ["release pad_south 120", "pad_left_x 0 120", "release stick_left 120"]);
});

test("what was deflected or pressed before the focus came is no press, and moves nothing until it was at rest", () => {
  pad.axes = [1, 0, 0, 0];
  read(110);
  hasFocus = false;
  pad.buttons[0] = { pressed: true, value: 1 };
  read(120);
  hasFocus = true;
  heard = [];
  read(130);
  assert.deepEqual(heard, ["held_before_focus pad_south 130", "pad_left_x 0 130", "held_before_focus stick_right 130"]);
  pad.axes = [0.6, 0, 0, 0];
  heard = [];
  read(140);
  pad.axes = [0, 0, 0, 0];
  pad.buttons[0] = { pressed: false, value: 0 };
  read(150);
  pad.axes = [1, 0, 0, 0];
  read(160);
  assert.deepEqual(heard, [
    "release pad_south 150", "release stick_right 150", "pad_left_x 1 160", "press stick_right 160",
  ]);
});

test("what changed is stamped by the gamepad's own time, but never before the last reading", () => {
  read(110);
  pad.buttons[1] = { pressed: true, value: 1 };
  pad.timestamp = 113;
  read(126);
  pad.buttons[1] = { pressed: false, value: 0 };
  pad.timestamp = 90;
  read(142);
  pad.axes = [0, 1, 0, 0];
  pad.timestamp = 147.5;
  read(159);
  assert.deepEqual(heard, ["press pad_east 113", "release pad_east 126", "pad_left_y 1 147.5", "press stick_down 147.5"]);
});

test("while the server is behind, sticks wait for the next step and buttons do not", () => {
  isBehind = true;
  pad.axes = [-1, 0, 0, 0];
  pad.buttons[0] = { pressed: true, value: 1 };
  read(110);
  pad.axes = [0.55, 0, 0, 0];
  read(126);
  assert.deepEqual(heard, ["press pad_south 110"]);
  now = 130;
  reader.readSticks();
  assert.deepEqual(heard.slice(1), ["pad_left_x 0.5 130"]);
});
