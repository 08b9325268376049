// The sound device's clock as the page fits it to the session's.

import assert from "node:assert/strict";
import { test } from "node:test";

import { DeviceClock } from "../../../minihuman/web/page/sounds.js";

const MS = 1e6;

/** What Chromium tells: its clock moves on every 11.6 ms, and jitters between -6 and 6 ms. @param {number} count */
function feed(clock, count, offset, begin = 0) {
  for (let look = begin; look < begin + count; look++) {
    const deviceS = look * 0.0116;
    clock.add(deviceS, offset + deviceS * 1e9 + (((look * 1.02) % 12) - 6) * MS);
  }
}

test("onsets are known better than one look at the device's clock", () => {
  const clock = new DeviceClock();
  feed(clock, 50, 5e9);
  assert.equal(clock.isReady, false);
  feed(clock, 400, 5e9, 50);
  assert.ok(clock.isReady);
  assert.ok(Math.abs(clock.sessionTime(2) - 7e9) < 0.5 * MS);
  assert.ok(Math.abs(clock.deviceTime(7e9) - 2) < 0.0005);
  assert.ok(clock.uncertainty >= MS && clock.uncertainty < 4 * MS);
});

test("a device that was changed or slept begins the clock anew, a few late looks do not", () => {
  const clock = new DeviceClock();
  feed(clock, 200, 5e9);
  feed(clock, 20, 5.5e9, 200);
  assert.ok(Math.abs(clock.offset - 5e9) < MS);
  feed(clock, 200, 5.5e9, 220);
  assert.ok(Math.abs(clock.offset - 5.5e9) < MS);
});
