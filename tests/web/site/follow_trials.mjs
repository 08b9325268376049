// Walks through a site's session in Node: drawn keys, pauses and late reports, and time as the follower wants it told.
// Prints each walk's messages, with the screen and the due time after each.

import { pathToFileURL } from "node:url";

const [site, seed, nWalks, nSteps] = process.argv.slice(2);
const { Follower } = await import(pathToFileURL(`${site}/static/follower.js`).href);
let text = "";
for await (const chunk of process.stdin) text += chunk;
const script = JSON.parse(text);
const modules = new Map();
for (const { run } of script.nodes) {
  if (run) modules.set(run.module, await import(pathToFileURL(`${site}/static/${run.module}`).href));
}

let state = Number(seed) >>> 0;
const draw = () => { // mulberry32
  state = (state + 0x6d2b79f5) >>> 0;
  let t = Math.imul(state ^ (state >>> 15), state | 1);
  t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
  return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
};
const choose = (list) => list[Math.floor(draw() * list.length)];

function walk() {
  let screen = null, tick = null, n = 0, at = 1000, shown = 0, focused = true;
  const names = [];
  const follower = new Follower(script, null, {
    message: (m) => {
      if (m.t === "screen") screen = m;
      if (m.t === "screen" || m.t === "now") tick = m.tick;
    },
    agreed() {}, settled() {}, picture() {},
  }, modules);
  const steps = [];
  const send = (what, delayUs) => {
    at += Math.max(1, Math.round(delayUs)) * 1000;
    const stamp = at - Math.floor(draw() * 20) * 1000;
    const timed = { ...what };
    if (what.t === "key" || what.t === "pointer") timed.stamp = stamp;
    if (what.t === "shown") Object.assign(timed, { flip: stamp, submit: stamp - 1000 });
    if (what.t === "sound") Object.assign(timed, { scheduled: stamp, onset: stamp, uncertainty: 1e6 });
    follower.receive({ n: ++n, at, what: timed });
    if (names.at(-1) !== screen.name) names.push(screen.name);
    steps.push({ n, at, what: timed, name: screen.name, due: follower.over ? null : tick });
  };
  send({ t: "tick" }, 1);
  while (steps.length < Number(nSteps) && !follower.over) {
    const by = draw() * 30e3, luck = draw();
    if (screen.id !== shown && luck < 0.9) {
      shown = screen.id;
      send({ t: "shown", screen: screen.id, name: screen.name }, by);
    } else if (luck < 0.5 && tick !== null) {
      send({ t: "tick" }, Math.max(1, (tick - at) / 1000) + (draw() < 0.5 ? 0 : by));
      if (screen.screen.kind === "activity" && draw() < 0.9) send({ t: "shown", screen: screen.id, name: screen.name }, by);
    } else if (luck < 0.55) send({ t: "shown", screen: screen.id, name: choose(names.slice(-3)) }, by);
    else if (luck < 0.65 && screen.screen.sounds?.length) send({ t: "sound", cue: choose(screen.screen.sounds).cue + choose([0, 0, 0, 1]) }, by);
    else if (luck < 0.68) send({ t: "focus", focused: (focused = !focused) }, by);
    else if (luck < 0.7) send({ t: "key", key: "f8", down: true }, by);
    else if (luck < 0.71) {
      send({ t: "key", key: "escape", down: true }, by);
      if (draw() < 0.8) send({ t: "key", key: "enter", down: true }, by);
    } else if (luck < 0.75) {
      const what = choose(["pressed", "moved", "released"]);
      send({ t: "pointer", what, x: 0.5, y: 0.5, target: choose(["", "go_on"]), along: 0, cause: choose(["finger", "finger", "held_before_focus"]) }, by);
    } else if (luck < 0.87) send({ t: "key", key: "enter", down: true }, by);
    else {
      const key = choose(["f", "j", "f", "j", "x"]);
      send({ t: "key", key, down: true, repeat: draw() < 0.1 }, by);
      if (draw() < 0.5) send({ t: "key", key, down: false }, by);
    }
  }
  return steps;
}

console.log(JSON.stringify(Array.from({ length: Number(nWalks) }, walk)));
