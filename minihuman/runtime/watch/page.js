"use strict";
const by = id => document.getElementById(id), cards = new Map(), rows = new Map(), open = new Set();
const FEW = 4;            // so many sessions are all open at once
const STALLED_S = 60;     // nothing was pressed for so long
const SILENT_S = 30;      // a browser says something every ten seconds
const clock = s => `${Math.floor(s / 60)}:${String(s % 60).padStart(2, "0")}`;
function make(tag, words, kind) {
  const one = document.createElement(tag);
  if (words !== undefined) one.textContent = words;
  if (kind) one.className = kind;
  return one;
}
const post = (path, values) => fetch(path, {
  method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(values),
});
async function ask(session, what, text) {
  await post(`ask?session=${encodeURIComponent(session)}`, { what, text });
  look();
}
function card(name) {
  const box = make("article");
  box.innerHTML = `<h2><span class="who"></span><small class="time"></small></h2><progress max="1" aria-label="episodes done"></progress>
    <div class="now"><img alt="what the participant sees"><dl></dl></div>
    <div class="keys"></div><svg preserveAspectRatio="none" viewBox="0 0 60 20" aria-hidden="true"></svg><div class="rt empty"></div>
    <ol></ol><form><input aria-label="note" placeholder="a note, kept in the log with its time"><button>Note</button>
    <button type="button" class="pause">Pause</button><button type="button" class="stop">Abort</button></form>`;
  const field = box.querySelector("input");
  box.querySelector("form").addEventListener("submit", event => {
    event.preventDefault();
    if (field.value.trim()) { ask(name, "note", field.value.trim()); field.value = ""; }
  });
  box.querySelector(".pause").addEventListener("click", event => ask(name, event.target.dataset.what, ""));
  box.querySelector(".stop").addEventListener("click", () => {
    const why = prompt("End this session for good? Say why; it is kept in the log.", "");
    if (why !== null) ask(name, "abort", why || "no reason given");
  });
  by("sessions").append(box);
  return box;
}
const ago = one => one.idle_s === undefined ? "" : `${one.idle_s} s ago${one.idle_s > STALLED_S ? ", stalled" : ""}`;
const latency = one => one.rtt_ms == null ? "" : one.silent_s > SILENT_S ? `silent for ${one.silent_s} s` : `${one.rtt_ms} ms (least ${one.least_rtt_ms})`;
function row(name) {
  const one = make("tr"), choose = make("button");
  const who = make("th");
  who.scope = "row";
  choose.type = "button";
  choose.addEventListener("click", () => { open.has(name) ? open.delete(name) : open.add(name); look(); });
  who.append(choose);
  one.append(who, ...Array.from({ length: 7 }, () => make("td")));
  document.querySelector("#table tbody").append(one);
  return one;
}
function fillRow(one, name, facts) {
  const choose = one.querySelector("button"), cells = one.querySelectorAll("td");
  choose.textContent = facts.participant || name;
  choose.setAttribute("aria-expanded", String(open.has(name)));
  const words = [facts.group, facts.phase + (facts.paused ? ` (${facts.paused})` : ""),
    facts.blocks ? `${facts.block_number} of ${facts.blocks}` : "", facts.episodes ? `${facts.episode} of ${facts.episodes}` : "",
    `${facts.done} of ${facts.planned}`, ago(facts), latency(facts)];
  words.forEach((text, index) => { cells[index].textContent = text || ""; });
  one.classList.toggle("stalled", facts.idle_s > STALLED_S || (facts.rtt_ms != null && facts.silent_s > SILENT_S));
}
function recruiting(now) {
  const box = by("recruiting"), button = box.querySelector("button");
  box.hidden = !now;
  if (!now) return;
  box.querySelector("span").textContent = `Recruitment is ${now.open ? "open" : "closed"}: ${now.came} came, ${now.reading} of them have not agreed yet; ${now.links} links.`;
  button.textContent = now.open ? "Close recruitment" : "Open recruitment";
  button.onclick = async () => { await post("recruit", { open: !now.open }); look(); };
}
function fill(box, name, one) {
  const put = (where, words) => { box.querySelector(where).textContent = words; };
  put(".who", one.participant ? `${one.participant}, ${one.group}` : name);
  put(".time", one.participant ? `session ${one.session}${one.segment > 1 ? `, segment ${one.segment}` : ""}   ${clock(one.elapsed_s)}` : "");
  box.classList.toggle("paused", Boolean(one.paused));
  box.querySelector("progress").value = one.planned ? one.done / one.planned : 0;
  const facts = [["now", one.phase + (one.paused ? ` (${one.paused})` : "")],
    ["part", one.blocks ? `${one.block_number} of ${one.blocks}: ${one.block}` : ""],
    ["episode", one.episodes ? `${one.episode} of ${one.episodes}; ${one.done} of ${one.planned} in all` : ""],
    ["steps", one.most_steps ? `${one.steps} of at most ${one.most_steps}` : ""],
    ["return", one.episodes ? `${one.return}${one.outcome ? `, ${one.outcome}` : ""}` : ""],
    ["last press", ago(one)], ["latency", latency(one)], ["world", one.world || ""], ["mission", one.mission || ""], ["problem", one.problem || ""]];
  box.querySelector("dl").replaceChildren(...facts.filter(([, words]) => words).flatMap(([what, words]) => [make("dt", what), make("dd", words)]));
  box.querySelector(".keys").replaceChildren(...(one.keys || []).map(press => {
    const cap = make("kbd", press.key, ["accepted", "queued"].includes(press.verdict) ? "" : "vain");
    cap.title = press.verdict;
    return cap;
  }));
  const times = one.times_ms || [], most = Math.max(1000, ...times);
  box.querySelector("svg").innerHTML = times.map((ms, index) => `<rect x="${index}" width=".8" y="${20 - 20 * ms / most}" height="${20 * ms / most}" fill="#0072b2"/>`).join("");
  const sorted = [...times].sort((a, b) => a - b);
  put(".rt", times.length ? `reaction times, last ${times.length}: median ${sorted[times.length >> 1]} ms, longest ${sorted[times.length - 1]} ms; ${one.presses} presses` : "no reaction times yet");
  box.querySelector("ol").replaceChildren(...(one.notes || []).slice().reverse().map(note => {
    const item = make("li", "", note.kind === "page" ? "deviates" : "");
    item.append(make("time", clock(note.s)), make("b", `${note.kind} `), note.text);
    return item;
  }));
  const pause = box.querySelector(".pause"), what = one.paused ? "go_on" : "pause";
  pause.textContent = one.paused ? "Go on" : "Pause"; pause.dataset.what = what;
  pause.disabled = !one.paused && one.phase !== "playing";
  box.querySelector("img").src = `picture?session=${encodeURIComponent(name)}&${Date.now()}`;
}
async function look() {
  let state;
  try { state = await (await fetch("state")).json(); } catch { by("lost").hidden = false; return; }
  by("lost").hidden = true;
  by("study").textContent = state.study;
  const names = Object.keys(state.sessions);
  by("count").textContent = names.length ? `${names.length} session${names.length > 1 ? "s" : ""} running` : "No session is running now; one that starts appears by itself.";
  recruiting(state.recruiting);
  by("table").hidden = names.length <= FEW;
  for (const [name, one] of rows) if (!names.includes(name)) { one.remove(); rows.delete(name); open.delete(name); }
  for (const name of names) {
    if (!rows.has(name)) rows.set(name, row(name));
    fillRow(rows.get(name), name, state.sessions[name]);
  }
  const seen = names.length <= FEW ? names : names.filter(name => open.has(name));
  for (const [name, box] of cards) if (!seen.includes(name)) { box.remove(); cards.delete(name); }
  for (const name of seen) {
    if (!cards.has(name)) cards.set(name, card(name));
    fill(cards.get(name), name, state.sessions[name]);
  }
  by("status").textContent = state.status.join("\n");
}
look();
setInterval(look, 1000);
