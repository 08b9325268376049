// Where no socket brings a welcome, a page speaks over HTTP; a request that fails is repeated without harm.

import assert from "node:assert/strict";
import { beforeEach, mock, test } from "node:test";

import { Connection } from "../../../minihuman/web/page/connection.js";
import { PollingSocket } from "../../../minihuman/web/page/polling.js";
import { MemoryStorage, Outbox } from "../../../minihuman/web/page/stream.js";

const WELCOME = {
  t: "welcome", segment: "s", life: "l", again: false, heard: 0, now: 1, keys: {}, touch: {}, token: "", words: {}, taken: 0,
  gamepad: false, sign_ms: 1000,
};

class SilentSocket {
  static OPEN = 1;
  static made = [];
  readyState = 0;
  constructor() { SilentSocket.made.push(this); }
  send() {}
  close() { this.readyState = 3; }
}

/** A batch as the server sends it. */
function encode(...messages) {
  const parts = messages.map((message) => Buffer.from(JSON.stringify(message)));
  return Buffer.concat(parts.flatMap((part) => {
    const head = Buffer.alloc(5);
    head.writeUInt32LE(part.length, 1);
    return [head, part];
  }));
}

/** The server behind `fetch`: what it was asked, and what it answers. */
class Server {
  requests = [];
  isReachable = true;
  failures = 0; // of the next requests
  waiting = [];

  async fetch(address, { body, signal } = {}) {
    if (!this.isReachable) throw new TypeError("no network");
    if (address === "/favicon.ico") return new Response("", { status: 200 });
    const request = JSON.parse(body);
    this.requests.push(request);
    if (this.failures) {
      this.failures -= 1;
      throw new TypeError("cut");
    }
    if (request.texts) return new Response(null, { status: 204 });
    return new Promise((resolve, reject) => {
      this.waiting.push(resolve);
      signal.addEventListener("abort", () => reject(new TypeError("aborted")));
    });
  }

  answer(status, body) { this.waiting.shift()(new Response(body, { status })); }
  get brought() { return this.requests.filter(({ texts }) => texts); }
  get fetched() { return this.requests.filter(({ texts }) => !texts); }
}

let server, ms = 0;

/** Let time pass, and promises that wait for nothing but each other resolve. */
async function wait(passedMs) {
  for (let passed = 0; passed < passedMs; passed += 100) {
    ms += 100;
    mock.timers.tick(100);
    for (let turn = 0; turn < 5; turn++) await new Promise((resolve) => { setImmediate(resolve); });
  }
}

function openConnection() {
  const listener = Object.fromEntries(
    ["welcome", "reset", "resume", "message", "acknowledged", "status", "leave"].map((name) => [name, mock.fn()]));
  const connection = new Connection(
    new Outbox(new MemoryStorage(), performance), { token: "t", platform: {}, made: false }, listener);
  connection.open();
  return { connection, listener };
}

beforeEach(() => {
  mock.restoreAll();
  mock.timers.reset();
  mock.timers.enable({ apis: ["setTimeout"] });
  mock.method(performance, "now", () => ms);
  ms = 1_000_000;
  server = new Server();
  SilentSocket.made = [];
  globalThis.WebSocket = SilentSocket;
  globalThis.location = { protocol: "http:", host: "x" };
  globalThis.fetch = (...call) => server.fetch(...call);
});

test("a page without a welcome speaks over HTTP after three seconds, and gives its socket up when that answers", async () => {
  const { connection, listener } = openConnection();
  await wait(2900);
  assert.equal(server.requests.length, 0);
  await wait(400);
  assert.equal(JSON.parse(server.brought[0].texts[0]).t, "hello");
  assert.notEqual(SilentSocket.made[0].readyState, 3);
  server.answer(200, encode(WELCOME));
  await wait(100);
  assert.equal(connection.welcomed, true);
  assert.equal(SilentSocket.made[0].readyState, 3);
  assert.equal(listener.welcome.mock.callCount(), 1);
  await wait(5000);
  assert.equal(SilentSocket.made.length, 1, "no socket is tried while HTTP works");
  assert.deepEqual(listener.leave.mock.calls, []);
  connection.close();
});

test("a socket that is welcomed in the meantime counts, and HTTP is given up", async () => {
  const { connection } = openConnection();
  await wait(3300);
  const [socket] = SilentSocket.made;
  socket.readyState = 1;
  socket.onmessage({ data: JSON.stringify(WELCOME) });
  assert.equal(connection.welcomed, true);
  const requests = server.fetched.length;
  await wait(5000);
  assert.equal(server.fetched.length, requests);
  connection.close();
});

test("a server that was away gets a socket's time again before HTTP is tried", async () => {
  const { connection } = openConnection();
  server.isReachable = false;
  await wait(4000);
  server.isReachable = true;
  await wait(4000);
  assert.equal(server.requests.length, 0);
  await wait(3000);
  assert.equal(server.brought.length, 1);
  connection.close();
});

test("a request that fails is repeated under its number, and what is sent meanwhile goes in one", async () => {
  const line = new PollingSocket("1");
  line.onopen = () => line.send("hello");
  await wait(100);
  server.failures = 2;
  line.send("a");
  line.send("b");
  line.send("c");
  await wait(1500);
  assert.deepEqual(server.brought.map(({ n, texts }) => [n, texts]), [
    [1, ["hello"]], [2, ["a"]], [2, ["a"]], [2, ["a"]], [3, ["b", "c"]]]);
  line.close();
});

test("a line that fails over and over ends, and so does one that the server ended, with the server's code", async () => {
  for (const [end, code] of [[() => { server.isReachable = false; line.send("a"); }, 1006],
    [() => server.answer(410, JSON.stringify({ code: 4001, reason: "" })), 4001]]) {
    server = new Server();
    var line = new PollingSocket("1");
    const closed = mock.fn();
    line.onopen = () => line.send("hello");
    line.onclose = closed;
    await wait(200);
    end();
    await wait(3000);
    assert.deepEqual(closed.mock.calls.map((call) => call.arguments[0].code), [code]);
  }
});
