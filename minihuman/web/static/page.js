// The page: it stamps and numbers what a person does, shows what the server says, and goes ahead of it in an episode.
// It decides nothing: the session is the server's, and what is shown here in advance is held against it at each step.

import { Onward } from "./onward.js";

const VERSION = 3;
const main = document.getElementById("screen");
const line = document.getElementById("line");
const ns = (ms) => Math.round(ms * 1e6);

// ---- kept over reloads -------------------------------------------------------------------------------------------

const kept = (() => {
  let state = { stream: randomName(), next: 1, segment: "", last: 0, zero: 0, facts: null };
  try { state = { ...state, ...JSON.parse(sessionStorage.getItem("stream") ?? "{}") }; } catch { /* nothing kept */ }
  return state;
})();
const outbox = new Map(); // number -> text, until it is on the server's disk
for (let i = 0; i < sessionStorage.length; i++) {
  const name = sessionStorage.key(i);
  if (name.startsWith("m")) outbox.set(Number(name.slice(1)), sessionStorage.getItem(name));
}
const keep = () => sessionStorage.setItem("stream", JSON.stringify(kept));

// Which of several servers a seat is on: a proxy goes by it. It says nothing of the link.
function pin() {
  const came = [...JSON.stringify([link.token, link.platform])];
  return came.reduce((sum, letter) => Math.imul(sum ^ letter.codePointAt(0), 16777619) >>> 0, 2166136261).toString(16);
}

function randomName() {
  return Array.from(crypto.getRandomValues(new Uint8Array(8)), (b) => b.toString(16).padStart(2, "0")).join("");
}

// ---- the clock: the session's time is this page's, ns since the segment began -------------------------------------

let zero = null; // performance time at the session's time 0, ns; null until it is known
if (kept.segment) zero = kept.zero - ns(performance.timeOrigin);
const timeOf = (ms) => Math.max(0, ns(ms) - zero);
const now = () => timeOf(performance.now());

function setTime(segment, serverNow, fresh) {
  if (kept.segment !== segment) {
    const unheard = [...outbox.values()].map((text) => JSON.parse(text)).filter((m) => m.what.t === "key" && m.what.down);
    for (const n of [...outbox.keys()].sort((a, b) => a - b)) forget(n);
    zero = ns(performance.now()) - serverNow;
    Object.assign(kept, { segment, last: 0 });
    remember();
    if (unheard.length) {
      say({ t: "unheard", text: unheard.map((m) => `${m.what.key} at ${m.what.stamp} ns`).join(", ").slice(0, 1900) });
    }
  } else if (zero === null || (fresh && Math.abs(now() - serverNow) > 2e9)) {
    zero = ns(performance.now()) - Math.max(serverNow, kept.last + 1);
  }
  remember();
}

function remember() {
  kept.zero = zero + ns(performance.timeOrigin);
  keep();
}

// ---- the stream ---------------------------------------------------------------------------------------------------

let socket = null;
let welcomed = false;
let life = ""; // the server's numbering
let heard = 0; // of it
let taken = 0; // the session has all that is not later, though it may not be acknowledged: its server was another one
let finished = false; // do not come again
let waitMs = 200;
let codes = {};
let said = { connecting: "…", reconnecting: "…", elsewhere: "…", title: "" }; // the server's words, in the study's language
let refusal = "";

const UNTIMED = new Set(["shown", "link", "unheard"]); // what does not tell the session the time

function say(what) {
  if (zero === null) return 0;
  const at = Math.max(kept.last + 1, now());
  const n = kept.next++;
  kept.last = at;
  const text = JSON.stringify({ t: "n", n, at, what });
  outbox.set(n, text);
  sessionStorage.setItem(`m${n}`, text);
  keep();
  send(text, isWordOfAStep(what));
  if (!UNTIMED.has(what.t)) passTime(n, at);
  return n;
}

// Word of a step's picture goes with what is said next, if that is soon: nobody waits for it before an episode's end.
const WAIT_MS = 100;
let unsent = [];
let waitingToSend = null;
function send(text, canWait) {
  unsent.push(text);
  if (canWait) waitingToSend ??= setTimeout(sendAll, WAIT_MS);
  else sendAll();
}
function sendAll() {
  clearTimeout(waitingToSend);
  waitingToSend = null;
  if (welcomed && socket.readyState === WebSocket.OPEN) for (const text of unsent) socket.send(text);
  unsent = []; // what was not sent is in the outbox
}
function isWordOfAStep(what) {
  return what.t === "shown" && what.step > 0 && play?.number === what.episode && !play.ended && !play.agent;
}

function forget(n) {
  outbox.delete(n);
  sessionStorage.removeItem(`m${n}`);
}

function connect() {
  if (finished) return;
  const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket?seat=${kept.pin ??= pin()}`;
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  const mine = socket;
  socket.onopen = () => {
    const first = Math.min(kept.next, ...outbox.keys());
    mine.send(JSON.stringify({
      t: "hello", version: VERSION, token: link.token, platform: link.platform, stream: kept.stream, first,
      life, heard, segment: kept.segment, last: kept.last, facts: kept.facts,
    }));
  };
  socket.onmessage = (event) => { if (mine === socket) receive(event.data); };
  socket.onclose = (event) => {
    if (mine !== socket) return;
    welcomed = false;
    if (event.code === 4001) leave(said.elsewhere);
    else if (event.code === 4002) loadAgain();
    else if (event.code >= 4003 && event.code < 4100) leave(refusal);
    if (finished) return;
    setTimeout(() => { if (!welcomed && !finished) line.textContent = said.reconnecting; }, 1500);
    setTimeout(connect, waitMs);
    waitMs = Math.min(3000, waitMs * 1.6);
  };
}

// The server speaks otherwise since it was updated: what is kept goes to it from its own page. Only once in a while.
function loadAgain() {
  if (performance.now() < 5000) { leave(refusal); return; }
  finished = true;
  location.reload();
}

function leave(why) {
  finished = true;
  welcomed = false;
  line.textContent = "";
  main.className = "text";
  main.replaceChildren(el("p", { class: "body short", role: "alert", text: why }));
}

function receive(data) {
  if (!(data instanceof ArrayBuffer)) { take(JSON.parse(data)); return; }
  const view = new DataView(data);
  for (let at = 0; at < data.byteLength;) { // several as one
    const isPicture = view.getUint8(at), size = view.getUint32(at + 1, true), from = at + 5;
    at = from + size;
    if (!isPicture) { take(JSON.parse(utf8.decode(new Uint8Array(data, from, size)))); continue; }
    if (!isNext(view.getUint32(from, true))) continue;
    const number = view.getUint32(from + 4, true), encoding = view.getUint8(from + 8);
    const width = view.getUint16(from + 10, true), height = view.getUint16(from + 12, true);
    takePicture(number, encoding, width, height, new Uint8Array(data.slice(from + 14, at)));
  }
}

const utf8 = new TextDecoder();
function take(message) {
  if (message.n !== undefined) {
    if (isNext(message.n)) told[message.m.t](message.m);
  } else {
    aside[message.t](message);
  }
}

const MOST_UNTOLD = 100; // the server looks less far ahead of a page that has more to tell of
let hearing = null;
let heardTold = 0;
function isNext(n) {
  if (n !== heard + 1) return false;
  heard = n;
  if (heard >= heardTold + MOST_UNTOLD) tellHeard();
  else hearing ??= setTimeout(tellHeard, 1000);
  return true;
}
function tellHeard() {
  clearTimeout(hearing);
  hearing = null;
  heardTold = heard;
  if (welcomed) socket.send(JSON.stringify({ t: "heard", n: heard }));
}

const aside = {
  welcome(m) {
    const fresh = life === "";
    codes = m.keys;
    said = m.words;
    document.title = said.title;
    if (m.token) link.token = m.token;
    if (m.token || link.made) history.replaceState(null, "", `#t=${link.token}`);
    setTime(m.segment, m.now, fresh);
    taken = m.taken;
    if (m.heard >= kept.next) { // a copy of this tab has said more since
      Object.assign(kept, { next: m.heard + 1, last: Math.max(kept.last, taken) });
      keep();
    }
    if (!m.again) {
      heard = heardTold = 0;
      life = m.life;
      episodes.clear();
      pictures.clear();
      onward.clear();
      play = null;
    }
    unsent = [];
    for (const n of [...outbox.keys()].sort((a, b) => a - b)) if (n > m.heard) socket.send(outbox.get(n));
    welcomed = true;
    waitMs = 200;
    line.textContent = "";
    if (kept.last === 0) say({ t: "tick" });
    if (fresh && taken > 0) focused = null;
    tellFocus();
    measureLine();
  },
  refused(m) {
    refusal = m.words;
    kept.facts = null; // whoever comes again has made the window larger, or sits elsewhere
    keep();
  },
  acked(m) {
    for (const n of [...outbox.keys()]) if (n <= m.through) forget(n);
    if (onward.heard(m.through)) put(onward.told);
  },
  pong(m) { ponged(m); },
};

// ---- the line's times ---------------------------------------------------------------------------------------------

let samples = [];
let pings = 0;
let pinged = 0; // when the last one was sent that has no answer, ms
let linkedAt = -Infinity;
let links = 0;
let pinging = null;

function measureLine() {
  clearTimeout(pinging);
  samples = [];
  pings = 0;
  pinged = 0;
  ping();
}

function ping() {
  if (!welcomed) return;
  if (pinged && performance.now() - pinged > 8000) { socket.close(); return; }
  pinged ||= performance.now();
  socket.send(JSON.stringify({ t: "ping", sent: now() }));
  pings += 1;
  pinging = setTimeout(ping, pings < 4 ? 60 : 1250);
}

function ponged(m) {
  const back = now();
  pinged = 0;
  const rtt = (back - m.sent) - (m.answered - m.received);
  samples = [...samples.slice(-7), { sent: m.sent, received: m.received, answered: m.answered, back, rtt }];
  const soon = (links === 0 && samples.length >= 3) || (links === 1 && samples.length === 8); // a start is no quiet time
  if (soon || (samples.length >= 3 && performance.now() - linkedAt > 10000)) {
    links += 1;
    linkedAt = performance.now();
    const { rtt: least, ...best } = samples.reduce((a, b) => (a.rtt <= b.rtt ? a : b));
    say({ t: "link", ...best, latest: Math.max(0, rtt) });
  }
}

// ---- pictures -----------------------------------------------------------------------------------------------------

const pictures = new Map(); // number -> {encoding, width, height, bytes, bitmap: promise or null}
const drawnLately = new Map(); // number -> picture with a bitmap, the latest last
const MOST_BITMAPS = 160;
const UNPACKED_STEPS = 2;

function takePicture(number, encoding, width, height, bytes) {
  const picture = { number, encoding, width, height, bytes, bitmap: null, ready: null };
  pictures.set(number, picture);
}

// Let go of pictures of episodes that are over; the server would send them again.
function dropPictures(before) {
  const used = new Set();
  for (const { scenes } of episodes.values()) for (const { picture } of scenes.values()) used.add(picture);
  for (const { screen: s } of [screen, onward.told, ...onward.screens.values()].filter(Boolean)) {
    for (const number of [s.picture, s.pictures, s.lefts, s.rights].flat()) used.add(number);
  }
  for (const number of pictures.keys()) {
    if (number >= before || used.has(number)) continue;
    pictures.delete(number);
    drawnLately.delete(number);
  }
}

// Unpack what the next keys may lead to, from where we are; what is further away can wait.
function unpackAround(number, scene) {
  const { scenes } = episodeOf(number);
  let level = [scene];
  for (let steps = 0; steps <= UNPACKED_STEPS; steps++) {
    const following = [];
    for (const name of level) {
      const known = scenes.get(name);
      const picture = known && pictures.get(known.picture);
      if (!picture) continue;
      if (!picture.ready) bitmapOf(picture);
      for (const [to] of known.edges.values()) following.push(to);
    }
    level = following;
  }
}

function bitmapOf(picture) {
  drawnLately.delete(picture.number);
  drawnLately.set(picture.number, picture);
  while (drawnLately.size > MOST_BITMAPS) {
    const [oldest, old] = drawnLately.entries().next().value;
    drawnLately.delete(oldest);
    old.bitmap = old.ready = null;
  }
  picture.bitmap ??= unpack(picture).then((bitmap) => (picture.ready = bitmap));
  return picture.bitmap;
}

async function unpack({ encoding, width, height, bytes }) {
  if (encoding === 1) return createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
  const packed = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const rgb = new Uint8Array(await new Response(packed).arrayBuffer());
  const rgba = new Uint8ClampedArray(width * height * 4);
  for (let from = 0, to = 0; from < rgb.length; from += 3, to += 4) {
    rgba[to] = rgb[from];
    rgba[to + 1] = rgb[from + 1];
    rgba[to + 2] = rgb[from + 2];
    rgba[to + 3] = 255;
  }
  return createImageBitmap(new ImageData(rgba, width, height));
}

// ---- flips: a task posted from the frame that was drawn -----------------------------------------------------------

const flipped = new MessageChannel();
let waiting = null; // what is to be told of when it is there
flipped.port1.onmessage = () => {
  const shown = waiting;
  waiting = null;
  if (!shown || document.hidden) return;
  const flip = now();
  shown.then?.(flip);
  const { then, ...what } = shown;
  say({ t: "shown", ...what, flip });
};
function tellWhenShown(what) {
  const asked = waiting !== null;
  waiting = { submit: now(), ...what };
  if (!asked) requestAnimationFrame(() => flipped.port2.postMessage(0));
}

// ---- episodes: scenes, and where keys lead ------------------------------------------------------------------------

const agents = new Map(); // episode -> what an agent beside the person means in it; of the latest
const episodes = new Map(); // number -> {rules, scenes: name -> {picture, edges: action -> [scene, ends]}}
const onward = new Onward(); // the screens outside of them
let play = null; // the episode that is played: see begin()
let screen = null; // what the server wants seen
let due = null; // when the session wants to be told the time
let toldDue = null;

function episodeOf(number) {
  if (!episodes.has(number)) episodes.set(number, { rules: null, scenes: new Map() });
  return episodes.get(number);
}

const told = {
  rules(m) {
    for (const number of [...episodes.keys()]) if (number < m.episode) episodes.delete(number);
    episodeOf(m.episode).rules = m;
    agents.clear(); // whether one plays is told when it begins
    dropPictures(m.keep);
  },
  ahead(m) {
    const { scenes } = episodeOf(m.episode);
    for (const [name, picture] of m.nodes) {
      const known = scenes.get(name);
      if (known) known.picture = picture;
      else scenes.set(name, { picture, edges: new Map() });
    }
    for (const [from, action, to, ends] of m.edges) scenes.get(from)?.edges.set(action, [to, ends]);
    if (play?.number === m.episode) follow();
    else if (m.nodes.length && episodes.size) unpackAround(m.episode, m.nodes[0][0]); // before it begins
  },
  onward(m) { onward.learn(m); },
  frame(m) {
    for (const one of [film, reel]) if (one?.name === m.name) putIn(one.reels[m.side], m.place, m.picture);
  },
  beside(m) {
    agents.clear();
    agents.set(m.episode, m);
    if (play?.number === m.episode) play.agent = m;
  },
  now(m) {
    if (!onward.ahead) setDue(m.tick);
    if (m.step < 0) return;
    const { rules } = episodeOf(m.episode);
    if (!rules) return;
    if (play?.number !== m.episode) play = begin(m.episode, rules, m.through);
    play.confirmed = { step: m.step, scene: m.node, who: m.who, action: m.action, limit: m.limit };
    play.trail = play.trail.filter((press) => press.n > m.through);
    if (play.frozen && m.through >= play.frozen) play.frozen = 0;
    follow();
  },
  screen(m) {
    if (onward.tell(m)) put(m);
    else if (!onward.ahead) screen = m;
  },
  ask(m) { onward.unknown(say({ t: "asked", number: m.number })); },
  over(m) {
    finished = true;
    for (const n of [...outbox.keys()]) forget(n);
    sessionStorage.removeItem("stream");
    over(m);
  },
};

function put(m) {
  screen = m;
  entered = null;
  setDue(m.tick);
  const { kind } = m.screen;
  if (kind !== "play" || m.screen.picture !== undefined) play = null;
  show(m);
}

// An input went to the server as message n: show what it leads to, if that is known.
function goOn(n, input, at) {
  const to = onward.took(n, input, at);
  if (!to) return;
  const tick = to.after === null ? null : kept.last + to.after;
  put({ id: 0, name: to.name, through: n, at: kept.last, tick, screen: to.screen });
  const { rules } = to.episode < 0 ? {} : episodeOf(to.episode);
  if (!rules) return;
  play = begin(to.episode, rules, n);
  play.confirmed = { step: 0, scene: to.scene };
  if (to.screen.steers) play.frozen = n; // who steers is told when it has begun
  follow();
}

// What was pressed and is not in what the server says, before a reload too, is still to come.
function begin(number, rules, through) {
  const begun = {
    number, rules, confirmed: null, trail: [], step: -1, scene: -1, ended: false, frozen: 0,
    nextTick: null, queued: null, drawn: "", agent: agents.get(number), who: "", agentDue: null, flipped: null,
  };
  for (const n of [...outbox.keys()].sort((a, b) => a - b)) {
    const { at, what } = JSON.parse(outbox.get(n));
    if (n <= through || at <= taken) continue;
    if (begun.agent) { // whose steps lay between, nobody knows any more
      if (!UNTIMED.has(what.t)) begun.frozen = n;
    } else if (what.t === "focus" || (what.t === "tick" && rules.real_time) || (what.t === "key" && what.down && RESERVED.has(what.key))) {
      begun.frozen = n;
    } else if (what.t === "key" && what.down && !rules.real_time && !begun.frozen && (!what.repeat || rules.auto_repeat)) {
      const action = rules.actions[what.key];
      if (action !== undefined) begun.trail.push({ n, action });
    }
  }
  return begun;
}

// Where the session will be once it has heard of everything: the confirmed scene, and what was pressed since.
function follow() {
  const { scenes } = episodeOf(play.number);
  let { step, scene, who } = play.confirmed;
  let ended = step >= play.rules.most_steps;
  let known = scenes.has(scene);
  for (const press of play.trail) {
    who = press.who ?? who;
    if (press.action === null || ended || !known) continue;
    const edge = scenes.get(scene).edges.get(press.action);
    if (!edge) { known = false; continue; }
    step += 1;
    scene = edge[0];
    ended = edge[1] || step >= play.rules.most_steps;
    known = scenes.has(scene);
  }
  Object.assign(play, { step, scene, ended, known, who });
  if (scenes.has(scene)) {
    paint(scene, step);
    unpackAround(play.number, scene);
  }
  schedule();
}

function paint(scene, step) {
  const what = `${scene} ${step} ${play.who}`;
  putFrame(play.who ?? framed.who, play.agent?.said[play.who]);
  if (play.drawn === what) return;
  const toldSince = play.drawn === `${scene} ${step} undefined`; // who steers: the picture is there
  play.agentDue = null;
  if (toldSince) {
    play.drawn = what;
    if (play.flipped !== null) startAgent(play, scene, step, play.flipped);
    return;
  }
  play.flipped = null;
  const picture = pictures.get(episodeOf(play.number).scenes.get(scene).picture);
  if (!picture || !canvas) return;
  play.drawn = what;
  const mine = play;
  const put = () => {
    putPicture(picture);
    tellStep(mine, scene, step);
  };
  if (picture.ready) put();
  else bitmapOf(picture).then(() => { if (play === mine && play.drawn === what) put(); });
}

function tellStep(mine, scene, step) {
  const then = (flip) => {
    mine.nextTick ??= mine.rules.real_time ? flip + mine.rules.period : null;
    mine.flipped ??= flip;
    startAgent(mine, scene, step, flip);
    schedule();
  };
  tellWhenShown({ episode: mine.number, step, node: scene, then });
}

// Where an agent steers, its next step comes a period after its picture was there.
function startAgent(mine, scene, step, flip) {
  if (mine.agent && mine.drawn === `${scene} ${step} agent` && !mine.ended && !mine.frozen) {
    mine.agentDue ??= flip + mine.agent.period;
  }
}

// ---- beside an agent ----------------------------------------------------------------------------------------------

let film = null; // two stretches that are compared: see draw.pair
let flash = "";
let flashEnds = null;
let ratedAt = -Infinity;

// What was due by a message's time the session does before the message is looked at.
function passTime(n, at) {
  if (play?.agentDue != null && at >= play.agentDue && !play.frozen && !play.ended) {
    play.trail.push({ n, action: knowsAgent() ? play.confirmed.action : undefined });
    play.agentDue = null;
    follow();
  }
  if (film?.due != null && at >= film.due) turnFilm(film.step + 1 > film.length ? 0 : film.step + 1);
}

// Whether the agent's next action is known: the session has said what it makes of where we are.
const knowsAgent = () => play.known && play.step === play.confirmed.step && play.confirmed.action >= 0;

// A key while an agent plays, or while its last picture is held; whether it is done with.
function besideAgent(key, n, stamp, isRepeat) {
  const agent = play?.agent ?? (screen?.screen.kind === "play" ? [...agents.values()][0] : null);
  if (!agent) return false;
  if (agent.good && (key === agent.good || key === agent.bad) && !(play && (play.frozen || !play.confirmed))) {
    if (isRepeat && stamp < ratedAt + agent.apart) return true;
    ratedAt = stamp;
    setFlash(key === agent.good ? "good" : "bad", agent.flash);
    return true;
  }
  if (!play?.confirmed || play.frozen || play.ended) return false;
  if (key === agent.hand_back) {
    if (!isRepeat && play.who === "person") {
      play.trail.push({ n, action: null, who: "agent" });
      follow();
    }
    return true;
  }
  const action = agent.takes_over ? play.rules.actions[key] : undefined;
  const { limit } = play.confirmed;
  const over = limit != null && stamp >= limit;
  if (action !== undefined && !over && (!isRepeat || play.rules.auto_repeat)) {
    play.trail.push({ n, action, who: "person" });
    follow();
  }
  return !RESERVED.has(key);
}

function setFlash(what, lasts) {
  flash = what;
  clearTimeout(flashEnds);
  if (what) flashEnds = setTimeout(() => setFlash("", 0), lasts / 1e6);
  if (!canvas) return;
  putFrame();
  if (play) tellStep(play, play.scene, play.step);
  else heldShown?.();
}

let heldShown = null; // tells that a picture that is held was seen, again
// Every frame is laid out beforehand, so that a change of hands only shows another. The line below says it a frame later:
// painting words would hold up the picture that the key leads to.
const HANDS = ["agent", "person", "good", "bad"];
let framed = { who: "", said: "" };
let lineSays = "";
let saysSoon = false;
function putFrame(who = framed.who, text = framed.said) {
  framed = { who, said: text ?? "" };
  if (!canvas || !who) return;
  const now = flash || who;
  for (const frame of main.querySelectorAll(".frame")) frame.classList.toggle("on", frame.dataset.of === now);
  if (saysSoon || lineSays === JSON.stringify(toSay())) return;
  saysSoon = true;
  requestAnimationFrame(() => setTimeout(sayWhoSteers));
}

const toSay = () => ({
  now: flash || framed.who, texts: { good: "+", bad: "−", ...play?.agent?.said, [framed.who]: framed.said },
});

function sayWhoSteers() {
  saysSoon = false;
  if (!canvas || !framed.who) return;
  const { now, texts } = toSay();
  lineSays = JSON.stringify({ now, texts });
  for (const line of main.querySelectorAll(".steers span")) {
    const { of } = line.dataset;
    line.classList.toggle("on", of === now);
    if (line.textContent !== (texts[of] ?? "")) line.textContent = texts[of] ?? "";
  }
}

// A picture of a film, once it is there: the server draws one after the other.
function pictureIn(numbers, place) {
  if (numbers[place] >= 0) return Promise.resolve(pictures.get(numbers[place]));
  return new Promise((resolve) => {
    numbers.wanted ??= new Map();
    numbers.wanted.set(place, [...(numbers.wanted.get(place) ?? []), resolve]);
  });
}

function putIn(numbers, place, number) {
  numbers[place] = number;
  for (const resolve of numbers.wanted?.get(place) ?? []) resolve(pictures.get(number));
  numbers.wanted?.delete(place);
}

// Both stretches at a step; the session counts the same by the same times.
async function turnFilm(step) {
  const mine = film;
  Object.assign(mine, { step, due: null });
  const shown = await Promise.all(mine.reels.map((side) => pictureIn(side, Math.min(step, side.length - 1))));
  Promise.all(shown.map(bitmapOf)).then((bitmaps) => {
    if (film !== mine || mine.step !== step) return;
    bitmaps.forEach((bitmap, side) => {
      const { canvas: on } = mine.sides[side];
      if (on.width !== bitmap.width || on.height !== bitmap.height) {
        Object.assign(on, { width: bitmap.width, height: bitmap.height });
        on.classList.toggle("flat", shown[side].encoding === 0);
        fit(on, 0.62, 0.44);
      }
      mine.sides[side].drawImage(bitmap, 0, 0);
    });
    mine.bar.value = Math.min(1, step / Math.max(1, mine.length - 1));
    tellWhenShown({ screen: mine.id, name: mine.name, then: (flip) => {
      if (film === mine && mine.step === step) mine.due ??= flip + mine.period;
      schedule();
    } });
  });
}

let reel = null; // an episode that is gone through: see draw.film
async function turnReel(step) {
  const mine = reel;
  mine.step = step;
  const picture = await pictureIn(mine.pictures, step);
  bitmapOf(picture).then((bitmap) => {
    if (reel !== mine || mine.step !== step) return;
    const { canvas: on } = mine.on;
    if (on.width !== bitmap.width || on.height !== bitmap.height) {
      Object.assign(on, { width: bitmap.width, height: bitmap.height });
      on.classList.toggle("flat", picture.encoding === 0);
      fit(on, 0.74);
    }
    mine.on.drawImage(bitmap, 0, 0);
    mine.bar.value = step / Math.max(1, mine.pictures.length - 1);
    tellWhenShown({ screen: mine.id, name: mine.name });
    for (const next of mine.pictures.slice(step + 1, step + 9)) if (next >= 0) bitmapOf(pictures.get(next));
  });
}

// ---- time ---------------------------------------------------------------------------------------------------------

let entered = null; // when a timed screen was there
let timer = null;

function setDue(tick) {
  due = tick;
  schedule();
}

function nextTime() {
  let time = due !== null && due !== toldDue ? due : null;
  if (entered !== null) time = entered.until > kept.last ? entered.until : time;
  if (play?.nextTick != null && !play.frozen) time = time === null ? play.nextTick : Math.min(time, play.nextTick);
  if (play?.agentDue != null && knowsAgent()) time = time === null ? play.agentDue : Math.min(time, play.agentDue);
  if (film?.due != null) time = film.due;
  return time;
}

function schedule() {
  clearTimeout(timer);
  const time = nextTime();
  if (time === null || zero === null) return;
  timer = setTimeout(tick, Math.max(0, (time - now()) / 1e6));
}

function tick() {
  const time = nextTime();
  if (time === null) return;
  if (now() < time) { schedule(); return; }
  const n = say({ t: "tick" });
  if (due !== null && kept.last >= due) toldDue = due;
  if (entered !== null && kept.last >= entered.until) entered = null;
  if (!play) goOn(n, "tick", kept.last);
  if (play?.nextTick != null && kept.last >= play.nextTick) {
    const { rules } = play;
    play.nextTick += rules.period * (Math.floor((kept.last - play.nextTick) / rules.period) + 1);
    const action = play.queued ?? rules.noop;
    play.queued = null;
    if (action !== null && !play.ended && !play.frozen) {
      play.trail.push({ n, action });
      follow();
    }
  }
  schedule();
}

// ---- keys ---------------------------------------------------------------------------------------------------------

const REPEAT_DELAY_MS = 500;
const REPEAT_PERIOD_MS = 33;
const RESERVED = new Set(["escape", "f8", "f9", "f12"]);
const LEFT_TO_BROWSER = new Set(["F5", "F11"]);
const down = new Set();
let repeating = null;

addEventListener("keydown", (event) => {
  if (zero === null || finished) return;
  const key = codes[event.code] ?? `code_${event.code.replace(/[^A-Za-z0-9]/g, "").slice(0, 24)}`;
  const shortcut = event.ctrlKey || event.metaKey || event.altKey;
  const composes = event.isComposing || (isEntry() && event.keyCode === 229); // Safari: the Enter that ends it, too
  const typing = isEntry() && !composes;
  const scrolling = (event.code === "ArrowUp" || event.code === "ArrowDown") && /^(page|text)$/.test(screen?.screen.kind ?? "");
  if (!shortcut && !scrolling && !LEFT_TO_BROWSER.has(event.code) && !(typing && event.key.length === 1) && !composes) {
    event.preventDefault();
  }
  if (event.repeat || composes || down.has(key)) return;
  down.add(key);
  const symbol = event.key.length === 1 ? event.key : "";
  press(key, symbol, timeOf(event.timeStamp), event.isTrusted);
  clearTimeout(repeating);
  repeating = setTimeout(() => repeat(key, symbol), REPEAT_DELAY_MS);
}, { capture: true });

function repeat(key, symbol) {
  if (!down.has(key)) return;
  repeating = setTimeout(() => repeat(key, symbol), REPEAT_PERIOD_MS);
  press(key, symbol, now(), true, true);
}

addEventListener("keyup", (event) => {
  const key = codes[event.code] ?? `code_${event.code.replace(/[^A-Za-z0-9]/g, "").slice(0, 24)}`;
  if (zero === null || finished || !down.has(key)) return;
  clearTimeout(repeating);
  const up = event.key === "Meta" ? [...down] : [key]; // a Mac says nothing of keys that come up beside Command
  for (const one of up) {
    down.delete(one);
    say({ t: "key", key: one, down: false, stamp: timeOf(event.timeStamp), trusted: event.isTrusted });
  }
}, { capture: true });

function press(key, symbol, stamp, trusted, isRepeat = false) {
  const n = say({ t: "key", key, down: true, stamp, symbol, repeat: isRepeat, trusted });
  if (isEntry()) editByKey(key);
  if (film && key === film.again && !isRepeat) turnFilm(0);
  if (reel && (key === reel.back || key === reel.forward)) {
    const to = Math.min(Math.max(0, reel.step + (key === reel.forward ? 1 : -1)), reel.pictures.length - 1);
    if (to !== reel.step) turnReel(to);
  }
  if (besideAgent(key, n, stamp, isRepeat)) return;
  if (!play) {
    if (isRepeat) onward.unknown(n);
    else goOn(n, `key:${key}`, stamp);
    return;
  }
  if (!play.confirmed) return;
  const { rules } = play;
  if (RESERVED.has(key)) { if (!isRepeat) play.frozen = n; return; }
  const action = rules.actions[key];
  if (action === undefined || play.frozen || play.ended || (due !== null && !rules.real_time && stamp >= due)) return;
  if (rules.real_time) {
    if (!isRepeat) play.queued = action;
  } else if (!isRepeat || rules.auto_repeat) {
    play.trail.push({ n, action });
    follow();
  }
}

// ---- focus --------------------------------------------------------------------------------------------------------

let focused = true; // as the session knows it; null: it may have been told otherwise, by this tab before or by another
function tellFocus() {
  const is = document.hasFocus() && !document.hidden;
  if (is === focused || zero === null || finished) return;
  focused = is;
  if (!is) {
    down.clear();
    clearTimeout(repeating);
    waiting = null;
  }
  const n = say({ t: "focus", focused });
  onward.unknown(n);
  if (play) { play.frozen = n; play.nextTick = play.queued = play.agentDue = null; }
}
addEventListener("focus", tellFocus);
addEventListener("blur", tellFocus);
document.addEventListener("visibilitychange", tellFocus);

// ---- the pointer --------------------------------------------------------------------------------------------------

let pressedIn = null;
function point(what, event, element) {
  const box = element.getBoundingClientRect();
  const rtl = getComputedStyle(element).direction === "rtl";
  let along = box.width ? Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) : 0;
  if (rtl) along = 1 - along;
  const n = say({
    t: "pointer", what, target: element.dataset.target, along,
    x: Math.min(1, Math.max(0, event.clientX / innerWidth)), y: Math.min(1, Math.max(0, event.clientY / innerHeight)),
  });
  if (what === "pressed") goOn(n, `point:${element.dataset.target}`, kept.last);
  else if (what === "moved") onward.unknown(n);
}
addEventListener("pointerdown", (event) => {
  const element = event.target.closest?.("[data-target]");
  if (!element || pressedIn || event.button !== 0 || finished) return;
  pressedIn = element;
  element.setPointerCapture?.(event.pointerId);
  point("pressed", event, element);
});
// An answer draws the screen anew: what was pressed has another element then.
const asDrawn = (element) => (element.isConnected ? element : main.querySelector(`[data-target="${element.dataset.target}"]`));
addEventListener("pointermove", (event) => {
  const element = pressedIn?.dataset.target === "slider" ? asDrawn(pressedIn) : null;
  if (element) point("moved", event, element);
});
function release(event) {
  if (pressedIn) point("released", event, asDrawn(pressedIn) ?? pressedIn);
  pressedIn = null;
}
addEventListener("pointerup", release);
addEventListener("pointercancel", release);
// A click that no pointer made is a screen reader's.
addEventListener("click", (event) => {
  const element = event.target.closest?.("[data-target]");
  if (!element || event.detail !== 0 || pressedIn || finished) return;
  point("pressed", event, element);
  point("released", event, element);
});

// ---- text ---------------------------------------------------------------------------------------------------------

let field = null; // the element that is typed into
let composed = null; // the one in which an input method is at work
let late = null; // what is drawn once that is done: taken off the page for a moment, the field would lose its work
let draft = { text: "", caret: 0 };
const isEntry = () => screen?.screen.kind === "question" && screen.screen.item.form === "entry";

const MOST_LETTERS = 1000; // in a message
function typed(given) {
  const text = given.replace(/\p{Surrogate}/gu, "\ufffd"); // half of a letter, which no log holds
  const letters = [...text];
  for (let from = 0; from < letters.length; from += MOST_LETTERS) {
    onward.unknown(say({ t: "typed", text: letters.slice(from, from + MOST_LETTERS).join("") }));
  }
  const { item } = screen.screen;
  draft.text = draft.text.slice(0, draft.caret) + text + draft.text.slice(draft.caret);
  draft.caret += text.length;
  if (item.form === "entry") putDraft();
}

function editByKey(key) {
  const before = draft.text.slice(0, draft.caret);
  const after = draft.text.slice(draft.caret);
  const rtl = screen.screen.rtl ? -1 : 1;
  const last = [...before].pop() ?? "";
  const following = [...after][0] ?? "";
  if (key === "backspace") draft = { text: before.slice(0, before.length - last.length) + after, caret: draft.caret - last.length };
  else if (key === "delete") draft = { text: before + after.slice(following.length), caret: draft.caret };
  else if (key === "left" || key === "right") {
    const by = (key === "right" ? 1 : -1) * rtl;
    draft.caret = Math.min(draft.text.length, Math.max(0, draft.caret + by * ((by > 0 ? following : last).length || 1)));
  } else if (key === "home" || key === "end") draft.caret = key === "home" ? 0 : draft.text.length;
  else if ((key === "enter" || key === "kp_enter") && screen.screen.item.long) {
    draft = { text: `${before}\n${after}`, caret: draft.caret + 1 };
  } else return;
  putDraft();
}

function putDraft() {
  if (!field) return;
  if (field.value !== draft.text) field.value = draft.text;
  field.setSelectionRange(draft.caret, draft.caret);
}

function watchField(element) {
  element.addEventListener("beforeinput", (event) => {
    if (event.isComposing || event.inputType === "insertCompositionText") return;
    event.preventDefault();
    const text = event.data ?? event.dataTransfer?.getData("text/plain") ?? "";
    if (text && event.inputType.startsWith("insert")) typed(text);
  });
  element.addEventListener("compositionstart", () => { composed = element; });
  element.addEventListener("compositionend", (event) => {
    composed = null;
    if (field !== element) return; // another screen came
    if (event.data) typed(event.data);
    else putDraft();
    if (late === screen) show(late);
  });
}

// ---- screens: one function a kind ---------------------------------------------------------------------------------

let canvas = null;

function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "style") Object.assign(element.style, value);
    else if (name === "text") element.textContent = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return element;
}
const words = (tag, name, text) => (text ? el(tag, { class: name, text }) : null);
const capOf = (cap, above, pressed = false) => el("span", { class: pressed ? "cap pressed" : "cap" },
  above ? el("small", { text: above }) : null, el("span", { text: cap }));
const buttonsOf = (buttons) => el("div", { class: "buttons" }, buttons.map((button) =>
  el("button", { type: "button", tabindex: "-1", "data-target": button.name, disabled: !button.enabled, text: button.label })));

const draw = {
  text: (s) => [
    words("h1", "", s.title),
    words("p", "body short", s.body),
    s.keys.length ? el("ul", { class: "keyboard", style: { width: `${s.wide * 3}rem`, height: `${s.high * 3}rem` } },
      s.keys.map((key) => el("li", {
        "aria-label": `${key.cap} ${key.above}${key.pressed ? " ✓" : ""}`,
        style: { left: `${key.x * 3}rem`, top: `${key.y * 3}rem`, width: `${key.width * 3}rem`, height: "3rem" },
      }, capOf(key.cap, key.above, key.pressed)))) : null,
    words("p", "prompt", s.prompt),
    words("p", "progress", s.progress),
  ],
  blank: (s) => [s.cross ? el("div", { class: "cross", role: "img", "aria-label": "+" }) : null],
  play: (s) => {
    canvas ??= el("canvas", { role: "img" });
    canvas.setAttribute("aria-label", s.mission || s.progress);
    return [
      words("h1", "", s.mission) ?? el("h1"),
      el("div", { class: s.steers ? "picture framed" : "picture" }, canvas,
        s.steers ? HANDS.map((of) => el("div", { class: `frame ${of}`, "data-of": of })) : null,
        s.mark ? el("div", { class: `mark ${s.mark}` },
        el("span", { text: `${{ good: "✓", bad: "✗", neutral: "–" }[s.mark]} ${s.said}` })) : null),
      s.steers ? el("p", { class: "steers", role: "status" },
        HANDS.map((of) => el("span", { class: of, "data-of": of }))) : null,
      s.legend.length ? el("ul", { class: "legend" }, s.legend.map(([cap, above, action]) =>
        el("li", {}, capOf(cap, above), el("span", { text: action })))) : null,
      words("p", "progress", s.progress),
    ];
  },
  pair: (s) => {
    const sides = [1, 2].map((side) => el("canvas", { role: "img", "aria-label": `${s.title} ${side}` }));
    const bar = el("progress", { max: 1, value: 0, "aria-hidden": "true" });
    film = {
      ...s, reels: [s.lefts, s.rights], due: null, length: Math.max(s.lefts.length, s.rights.length), bar,
      sides: sides.map((side) => side.getContext("2d", { alpha: false })),
    };
    return [
      words("h1", "", s.title),
      el("div", { class: "films" }, sides),
      bar,
      words("p", "prompt", s.prompt),
      words("p", "progress", s.progress),
    ];
  },
  film: (s) => {
    const shown = el("canvas", { role: "img", "aria-label": s.progress });
    const bar = el("progress", { max: 1, value: 0, "aria-hidden": "true" });
    reel = { ...s, reels: [s.pictures], bar, on: shown.getContext("2d", { alpha: false }) };
    return [el("div", { class: "films" }, shown), bar, words("p", "prompt", s.prompt), words("p", "progress", s.progress)];
  },
  page: (s) => [
    words("h1", "", s.title),
    s.picture === null ? null : exampleOf(s),
    words("p", s.body.length < 160 && s.picture === null ? "body short" : "body", s.body),
    buttonsOf(s.buttons),
    words("p", "prompt", s.prompt),
    words("p", "progress", s.progress),
  ],
  question: (s) => [
    words("h1", "", s.title),
    el("p", { class: "body", id: "ask", text: s.ask }),
    items[s.item.form](s.item, s),
    el("p", { class: "note", role: "alert", text: s.note }),
    buttonsOf(s.buttons),
    words("p", "prompt", s.prompt),
    words("p", "progress", s.progress),
  ],
};

const optionOf = (label, index, { chosen, at, many }, extra) => el("div", {
  class: `option${chosen ? " chosen" : ""}${at ? " at" : ""}`, role: many ? "checkbox" : "radio",
  "aria-checked": String(chosen), "data-target": `option:${index}`, tabindex: "-1",
}, el("span", { class: many ? "box many" : "box" }), el("span", { text: label }), extra);

const items = {
  choices: (item) => el("div", { class: "options", role: item.many ? "group" : "radiogroup", "aria-labelledby": "ask" },
    item.options.map((label, index) => optionOf(label, index,
      { chosen: item.chosen.includes(index), at: index === item.at, many: item.many },
      index < 9 ? el("span", { class: "number", "aria-hidden": "true", text: index + 1 }) : null))),
  scale: (item) => el("div", { class: "scale" },
    el("div", { class: "points", role: "radiogroup", "aria-labelledby": "ask" }, item.options.map((label, index) =>
      optionOf(label, index, { chosen: index === item.chosen, at: false, many: false }))),
    el("div", { class: "ends" }, el("span", { text: item.low }), el("span", { text: item.high }))),
  slider: (item) => el("div", { class: "scale" },
    el("div", {
      class: "slider", "data-target": "slider", role: "slider", tabindex: "-1", "aria-labelledby": "ask",
      "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": Math.round((item.along ?? 0.5) * 100),
      "aria-valuetext": item.value || "–",
    }, el("div", { class: "track" }),
    Array.from({ length: item.ticks + 1 }, (_, tick) => el("div", { class: "tick", style: { insetInlineStart: `${(100 * tick) / item.ticks}%` } })),
    item.along === null ? null : el("div", { class: "thumb", style: { insetInlineStart: `${100 * item.along}%` } })),
    el("p", { class: "value", text: item.value }),
    el("div", { class: "ends" }, el("span", { text: item.low }), el("span", { text: item.high }))),
  entry: (item) => {
    field = el(item.long ? "textarea" : "input", {
      "data-target": "field", "aria-labelledby": "ask", autocomplete: "off", autocapitalize: "off", spellcheck: "false",
      type: item.long ? null : "text",
    });
    watchField(field);
    return el("div", { class: "entry" }, field, words("span", "unit", item.unit));
  },
};

function exampleOf(s) {
  const picture = pictures.get(s.picture);
  const shown = el("canvas", { role: "img", "aria-label": s.marks.map((mark) => mark[2]).join(", ") || s.title });
  if (picture) {
    shown.width = picture.width;
    shown.height = picture.height;
    fit(shown, 0.4);
    bitmapOf(picture).then((bitmap) => shown.getContext("2d").drawImage(bitmap, 0, 0));
  }
  return el("div", { class: "example" }, shown, s.marks.map(([x, y, label]) => [
    el("span", { class: "point", style: { left: `${100 * x}%`, top: `${100 * y}%` } }),
    el("span", { class: "label", text: label, style: x >= 0.5 ? { left: `calc(${100 * x}% + .7rem)`, top: `${100 * y}%` } : { right: `calc(${100 - 100 * x}% + .7rem)`, top: `${100 * y}%` } }),
  ]));
}

function putPicture(picture) {
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
    canvas.classList.toggle("flat", picture.encoding === 0);
    fit(canvas, share());
  }
  canvas.getContext("2d", { alpha: false }).drawImage(picture.ready, 0, 0);
}

// As large as there is room for; a picture of flat colours by a whole number where one fits.
function fit(shown, share, across = 0.94) {
  const room = Math.min((innerWidth * across) / shown.width, (innerHeight * share) / shown.height);
  const scale = room >= 1 && shown.classList.contains("flat") ? Math.floor(room) : room;
  shown.style.width = `${Math.round(shown.width * scale)}px`;
  shown.style.height = `${Math.round(shown.height * scale)}px`;
}
const share = () => (framed.who ? 0.7 : 0.74); // of the height; below a frame stands who steers
addEventListener("resize", () => {
  if (canvas) fit(canvas, share());
  if (reel) fit(reel.on.canvas, 0.74);
  for (const side of film?.sides ?? []) fit(side.canvas, 0.62, 0.44);
});

const LEAVING_S = 5;
let drawnEntry = "";
function show(m) {
  const s = m.screen;
  document.documentElement.lang = s.language;
  document.documentElement.dir = s.rtl ? "rtl" : "ltr";
  main.className = s.kind;
  const entry = isEntry() ? `${s.title}\n${s.ask}` : "";
  const held = entry && entry === drawnEntry ? field : null;
  if (held && held === composed) {
    late = m;
    return;
  }
  late = null;
  if (s.kind !== "play") canvas = null;
  field = film = reel = heldShown = null;
  main.replaceChildren(...draw[s.kind](s).flat().filter(Boolean));
  if (isEntry()) {
    const pending = [...outbox.values()].some((text) => JSON.parse(text).n > m.through);
    if (!held || !pending) draft = { text: s.item.text, caret: [...s.item.text].slice(0, s.item.caret).join("").length };
    if (held) { field.replaceWith(held); field = held; }
    putDraft();
    field.focus();
  } else if (document.activeElement !== main) main.focus({ preventScroll: true });
  drawnEntry = entry;
  if (s.kind === "film") {
    Object.assign(reel, { id: m.id, name: m.name });
    turnReel(s.step);
    return;
  }
  if (s.kind === "pair") {
    Object.assign(film, { id: m.id, name: m.name });
    turnFilm(s.step);
    return;
  }
  if (s.kind === "play") {
    if (s.steers) {
      putFrame(s.steers, s.steers_said);
      sayWhoSteers();
    }
    if (s.picture !== undefined) {
      const picture = pictures.get(s.picture);
      bitmapOf(picture).then(() => {
        if (screen.name !== m.name) return;
        putPicture(picture);
        const until = m.tick === null ? null : m.tick - m.at;
        const tell = () => tellWhenShown({ episode: s.episode, step: s.step, then: (flip) => enter(m, until, flip) });
        heldShown = tell;
        tell();
      });
    }
    return;
  }
  const lasts = s.kind === "blank" && m.tick !== null ? m.tick - m.at : null;
  tellWhenShown({ screen: m.id, name: m.name, then: (flip) => enter(m, lasts, flip) });
}

function enter(m, lasts, flip) {
  onward.sawAt(m.name, flip);
  if (screen.name !== m.name || lasts === null) return;
  entered = { until: flip + lasts };
  schedule();
}

function over(m) {
  const heading = main.querySelector("h1");
  main.className = "text";
  main.replaceChildren(...[
    heading,
    el("p", { class: "body short", role: "status", text: m.words }),
    m.code ? el("p", { class: "short" }, `${m.your_code}: `, el("strong", { class: "code", text: m.code })) : null,
    m.url ? el("p", { class: "short" }, el("a", { href: m.url, text: m.leave })) : null,
    m.url ? el("p", { class: "prompt", text: said.leaving.replace("{seconds}", LEAVING_S) }) : null,
  ].filter(Boolean));
  if (m.url) setTimeout(() => { location.href = m.url; }, LEAVING_S * 1000);
}

// ---- the beginning ------------------------------------------------------------------------------------------------

const link = (() => {
  const inFragment = new URLSearchParams(location.hash.slice(1));
  const asked = new URLSearchParams(location.search);
  const given = [...asked, ...inFragment].filter(([name, value]) => name !== "t" && name.length <= 64 && value.length <= 200)
    .slice(0, 12); // what is longer is no platform's
  const token = inFragment.get("t") ?? "";
  const made = !token && !given.length; // whoever comes by no link brings one of their own, for studies that take anybody
  return { token: made ? (kept.token ??= madeToken()) : token, platform: Object.fromEntries(given), made };
})();

// Another link was put into the address: another person, of whom nothing that is kept here is true.
addEventListener("hashchange", () => {
  finished = true;
  welcomed = false;
  socket?.close();
  sessionStorage.clear();
  location.reload();
});

function madeToken() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").slice(0, 22);
}

async function browserFacts() {
  const known = navigator.userAgentData?.brands?.find((brand) => !/not/i.test(brand.brand));
  const said = navigator.userAgent.match(/(Firefox|Edg|OPR|Chrome|Version)\/(\d+)/) ?? ["", "unknown", "0"];
  const family = { Version: "Safari", Edg: "Edge", OPR: "Opera" }[said[1]] ?? said[1];
  const [refresh_hz, trip] = await Promise.all([refresh(), roundTrip()]);
  return {
    browser: known ? known.brand.replace(/[^A-Za-z ]/g, "") : family,
    browser_version: known ? known.version : said[2],
    platform: (navigator.userAgentData?.platform ?? "").replace(/[^A-Za-z ]/g, ""),
    isolated: self.crossOriginIsolated === true,
    timer_step_ms: timerStep(),
    refresh_hz,
    ...trip,
    pixel_ratio: devicePixelRatio,
    window_px: `${innerWidth} x ${innerHeight}`,
    display_px: `${screenSize.width} x ${screenSize.height}`,
    touch: navigator.maxTouchPoints > 0,
    mouse: matchMedia("(pointer: fine)").matches,
    language: navigator.language,
  };
}
const screenSize = globalThis.screen;

function timerStep() {
  let least = Infinity;
  let last = performance.now();
  for (let i = 0; i < 20000 && least > 0.006; i++) {
    const t = performance.now();
    if (t > last) least = Math.min(least, t - last);
    last = t;
  }
  return least === Infinity ? 0 : Math.round(least * 1e6) / 1e6;
}

function refresh() {
  return new Promise((resolve) => {
    const frames = [];
    const frame = (t) => {
      frames.push(t);
      if (frames.length < 16) { requestAnimationFrame(frame); return; }
      const between = frames.slice(1).map((t2, i) => t2 - frames[i]).sort((a, b) => a - b);
      resolve(Math.round(10000 / between[7]) / 10);
    };
    requestAnimationFrame(frame);
    setTimeout(() => resolve(0), 1500);
  });
}

// How long the line takes there and back: the least of a few, before there is a socket.
async function roundTrip() {
  let rtt_ms = Infinity;
  for (let i = 0; i < 4; i++) {
    const asked = performance.now();
    try { await fetch("/favicon.ico", { cache: "no-store" }); } catch { break; }
    rtt_ms = Math.min(rtt_ms, performance.now() - asked);
  }
  return rtt_ms < Infinity ? { rtt_ms } : {};
}

// Whether the picture of every key is here.
function isReady() {
  const scene = play && episodes.get(play.number)?.scenes.get(play.scene);
  return Boolean(scene && play.known && Object.values(play.rules.actions).every((action) => scene.edges.has(action)));
}

// For whoever tests or watches: what the page has done so far.
globalThis.minihuman = {
  get state() {
    return {
      welcomed, finished, step: play?.step ?? -1, scene: play?.scene ?? -1, ended: play?.ended ?? false, pictures: pictures.size, playing: play !== null,
      confirmed: play?.confirmed?.step ?? -1, ready: isReady(), known: play?.known ?? false, unsafe: outbox.size, ways: onward.edges.get(onward.at)?.size ?? 0, foreseen: [...onward.edges.values()].reduce((sum, ways) => sum + ways.size, 0), ahead: onward.ahead, kind: screen?.screen.kind ?? "", now: zero === null ? 0 : now(),
    };
  },
};

kept.facts ??= await browserFacts();
keep();
connect();
