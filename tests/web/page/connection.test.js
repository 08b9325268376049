// A connection is opened again whenever it breaks, and when nothing comes of it.

import assert from "node:assert/strict";
import { beforeEach, mock, test } from "node:test";

import { Connection } from "../../../minihuman/web/page/connection.js";
import { MemoryStorage, Outbox } from "../../../minihuman/web/page/stream.js";

class SilentSocket {
  static OPEN = 1;
  static made = [];
  readyState = 0;
  sent = [];
  isClosed = false;
  constructor() { SilentSocket.made.push(this); }
  send(text) { this.sent.push(text); }
  close() { this.isClosed = true; }
  open() { this.readyState = 1; this.onopen(); }
}

let left = [];
let ms = 0;

function openConnection() {
  const listener = { status() {}, leave: (why) => left.push(why) };
  const connection = new Connection(new Outbox(new MemoryStorage(), performance), { token: "t", platform: {}, made: false }, listener);
  connection.open();
  return connection;
}

function wait(passedMs) {
  ms += passedMs;
  mock.timers.tick(passedMs);
}

beforeEach(() => {
  mock.restoreAll();
  mock.timers.reset();
  mock.timers.enable({ apis: ["setTimeout"] });
  mock.method(performance, "now", () => ms);
  ms = 1_000_000;
  left = [];
  SilentSocket.made = [];
  globalThis.WebSocket = SilentSocket;
  globalThis.location = { protocol: "http:", host: "x" };
});

for (const opens of [true, false]) {
  test(`a socket that ${opens ? "opens" : "does not open"} and brings nothing is given up for another`, () => {
    openConnection();
    const [first] = SilentSocket.made;
    if (opens) first.open();
    wait(19_999);
    assert.equal(first.isClosed, false);
    wait(1);
    assert.equal(first.isClosed, true);
    wait(1000);
    assert.equal(SilentSocket.made.length, 2);
    first.onclose({ code: 1006, reason: "" });
    wait(1000);
    assert.equal(SilentSocket.made.length, 2, "it was counted already");
    assert.deepEqual(left, []);
  });
}

test("a socket that brought something is waited for", () => {
  openConnection();
  const [first] = SilentSocket.made;
  first.open();
  first.onmessage({ data: JSON.stringify({ t: "pong" }) });
  wait(120_000);
  assert.equal(first.isClosed, false);
});

test("a late hello of its own that takes the session over does not send the page away, another tab does", () => {
  openConnection();
  SilentSocket.made[0].open();
  wait(20_000);
  wait(1000);
  const second = SilentSocket.made[1];
  second.open();
  second.onclose({ code: 4001, reason: "" });
  assert.deepEqual(left, []);
  wait(3000);
  const third = SilentSocket.made[2];
  third.open();
  third.onclose({ code: 4001, reason: "" });
  assert.equal(left.length, 1);
});


test("a page lets the server hear of it as often as the server asks, and says farewell", async () => {
  const connection = openConnection();
  const [socket] = SilentSocket.made;
  socket.open();
  connection.welcomed = true;
  connection.latency.restart(1000);
  for (let pings = 0; pings < 4; pings++) wait(60); // at a start they come faster
  const before = socket.sent.length;
  connection.latency.receive({ t: "pong", sent: 0, received: 0, answered: 0 });
  wait(999);
  assert.ok(socket.sent.length > before);
  connection.bidFarewell(true);
  assert.deepEqual(JSON.parse(socket.sent.at(-1)), { t: "bye", left: true });
});
