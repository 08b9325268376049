// What the page sent stays in the tab until it is acknowledged, is numbered over reloads and is sent again in order.

import assert from "node:assert/strict";
import { beforeEach, mock, test } from "node:test";

import { encodeMessage, IncomingStream, MemoryStorage, MessageStore, Outbox } from "../../../minihuman/web/page/stream.js";

/** A storage as a browser has it on the disk, some time ago. */
function copyOf(storage) {
  const other = new MemoryStorage();
  for (let i = 0; i < storage.length; i++) other.setItem(storage.key(i), storage.getItem(storage.key(i)));
  return other;
}

/** An IndexedDB of one store: of each transaction all is kept or nothing, when it commits. */
class SlowDatabase {
  kept = new Map();
  #open = [];

  transaction(_name, mode) {
    const changes = [], under = { objectStore: () => ({
      put: (text, key) => changes.push(() => this.kept.set(String(key), [key, text])),
      delete: (key) => changes.push(() => this.kept.delete(String(key))),
      getAllKeys: () => ({ result: [...this.kept.values()].map(([key]) => key) }),
      getAll: () => {
        const request = { result: [...this.kept.values()].map(([, text]) => text) };
        queueMicrotask(() => request.onsuccess());
        return request;
      },
    }) };
    if (mode) this.#open.push((isDone) => {
      if (isDone) changes.forEach((change) => change());
      (isDone ? under.oncomplete : under.onabort)();
    });
    return under;
  }

  /** @returns {boolean} whether a transaction was under way */
  commit(isDone = true) {
    const next = this.#open.shift();
    next?.(isDone);
    return next !== undefined;
  }

  async settle() { for (let i = 0; i < 5; i++) { await Promise.resolve(); while (this.commit()); } }
}

globalThis.IDBKeyRange ??= { bound: () => undefined };

const clock = { ms: 0, timeOrigin: 1000, now() { return this.ms; } };
const numbersOf = (texts) => texts.map((text) => JSON.parse(text)).map((sent) => (Array.isArray(sent) ? sent[1] : sent.n));

function openOutbox(storage = new MemoryStorage()) {
  const outbox = new Outbox(storage, clock);
  outbox.sent = [];
  outbox.transmit = (texts) => outbox.sent.push(...texts);
  return outbox;
}

beforeEach(() => {
  clock.ms = 100;
  mock.timers.reset();
  mock.timers.enable({ apis: ["setTimeout"] });
});

test("nothing is numbered before the session's time is known", () => {
  const outbox = openOutbox();
  assert.equal(outbox.add({ t: "tick" }), 0);
  assert.equal(outbox.size, 0);
});

test("messages are numbered from one, with times that increase although the clock stands still", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 5_000_000, true, 0);
  assert.deepEqual([1, 2, 3].map(() => outbox.add({ t: "tick" })), [1, 2, 3]);
  assert.deepEqual(outbox.list().map(({ at }) => at), [5_000_000, 5_001_000, 5_002_000]);
});

test("a message that can wait goes with the next one, in order", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  outbox.add({ t: "shown", submit: 0, flip: 0 }, 100);
  assert.deepEqual(outbox.sent, []);
  outbox.add({ t: "tick" });
  assert.deepEqual(numbersOf(outbox.sent), [1, 2]);
});

test("a message that can wait is sent alone when its time is over", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  outbox.add({ t: "shown", submit: 0, flip: 0 }, 100);
  mock.timers.tick(99);
  assert.deepEqual(outbox.sent, []);
  mock.timers.tick(1);
  assert.deepEqual(numbersOf(outbox.sent), [1]);
});

test("a key, its picture and its release are 150 bytes together, and what is no whole microsecond is sent in full", () => {
  const at = 3_599_123_456_000;
  const key = { t: "key", key: "arrow_left", down: true, stamp: at - 1_234_000, digest: "0123456789abcdef", symbol: undefined };
  const shown = { t: "shown", submit: at - 900_000, flip: at - 60_000, episode: 12, step: 345, node: undefined, then: undefined };
  const sent = [
    { n: 12_345, at, what: key }, { n: 12_346, at, what: shown },
    { n: 12_347, at, what: { t: "key", key: "arrow_left", down: false, stamp: at - 80_000, trusted: undefined } },
  ].map(encodeMessage);
  assert.deepEqual(sent.map((text) => JSON.parse(text)), [
    ["k", 12345, 3599123456, 1234, "arrow_left", 1, "0123456789abcdef"], ["s", 12346, 3599123456, 60, 900, 12, 345],
    ["k", 12347, 3599123456, 80, "arrow_left", 0],
  ]);
  assert.ok(sent.join("\n").length < 150, sent.join("\n"));
  for (const what of [{ ...key, stamp: at - 7 }, { ...key, trusted: false }, { ...shown, screen: 3 }, { t: "focus", focused: true }]) {
    assert.deepEqual(JSON.parse(encodeMessage({ n: 1, at, what })), JSON.parse(JSON.stringify({ t: "n", n: 1, at, what })));
  }
});

test("what is acknowledged is forgotten, and the rest survives a reload with its numbers and the session's time", () => {
  const storage = new MemoryStorage();
  const before = openOutbox(storage);
  before.setTime("a", 0, true, 0);
  for (let i = 0; i < 12; i++) before.add({ t: "tick" });
  before.acknowledge(8);
  clock.ms += 40;
  const after = openOutbox(storage);
  assert.deepEqual(after.list().map(({ n }) => n), [9, 10, 11, 12]);
  assert.equal(after.first, 9);
  assert.equal(after.now(), 40e6);
  assert.notEqual(after.state.stream, before.state.stream, "a copied tab sends others under the same numbers");
  assert.equal(after.add({ t: "tick" }), 13);
});

test("a new connection is sent what the server has not heard, and nothing twice", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  for (let i = 0; i < 11; i++) outbox.add({ t: "tick" });
  outbox.sent = [];
  outbox.add({ t: "shown", submit: 0, flip: 0 }, 100);
  assert.deepEqual(numbersOf(outbox.takeUnacknowledged(9)), [10, 11, 12]);
  mock.timers.tick(1000);
  assert.deepEqual(outbox.sent, []);
});

test("a tab that comes back goes on behind the time that another has reached", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  outbox.add({ t: "tick" });
  outbox.catchUp(9_500);
  assert.equal(outbox.add({ t: "tick" }), 2);
  assert.equal(outbox.list().at(-1)?.at, 10_000, "in whole microseconds");
});

test("a page whose clock stood still while another played is at once as late as the session", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  outbox.setTime("a", 600e9, false, 0);
  outbox.catchUp(600e9);
  clock.ms += 1000;
  assert.equal(outbox.now(), 601e9);
});

test("keys that a segment had not heard are reported to the next one, which hears nothing else of them", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  const key = { t: "key", key: "left", stamp: 7, trusted: true };
  outbox.add({ ...key, down: true });
  outbox.add({ ...key, down: false });
  outbox.setTime("b", 0, false, 0);
  assert.deepEqual(outbox.list().map(({ what }) => what), [{ t: "unheard", text: "left at 7 ns" }]);
});

test("a page that was loaded again takes over a time that differs by more than two seconds, and never goes back", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  outbox.setTime("a", 1e9, true, 0);
  assert.equal(outbox.now(), 0);
  outbox.setTime("a", 5e9, false, 0);
  assert.equal(outbox.now(), 0);
  outbox.setTime("a", 5e9, true, 0);
  assert.equal(outbox.now(), 5e9);
});

test("with a storage that is full, everything is sent all the same, and again on a new connection", () => {
  const storage = new MemoryStorage();
  const outbox = openOutbox(storage);
  outbox.setTime("a", 0, true, 0);
  outbox.add({ t: "tick" });
  storage.setItem = () => { throw new Error("QuotaExceededError"); };
  outbox.add({ t: "tick" });
  outbox.add({ t: "tick" });
  assert.deepEqual(numbersOf(outbox.sent), [1, 2, 3]);
  assert.deepEqual(numbersOf(outbox.takeUnacknowledged(1)), [2, 3]);
});

test("a storage that holds nonsense is an empty one", () => {
  const storage = new MemoryStorage();
  storage.setItem("stream", "{");
  assert.equal(openOutbox(storage).state.next, 1);
});

test("what comes is taken once and in order", () => {
  const incoming = new IncomingStream(() => {});
  assert.deepEqual([1, 1, 3, 2, 3, 2].map((n) => incoming.take(n)), [true, false, false, true, true, false]);
  assert.equal(incoming.received, 3);
});

test("what was heard is reported after a second, and at once after a hundred messages", () => {
  const reports = [];
  const incoming = new IncomingStream((heard) => reports.push(heard));
  incoming.take(1);
  incoming.take(2);
  mock.timers.tick(1000);
  assert.deepEqual(reports, [2]);
  for (let n = 3; n <= 102; n++) incoming.take(n);
  assert.deepEqual(reports, [2, 102]);
  mock.timers.tick(5000);
  assert.deepEqual(reports, [2, 102]);
});

test("in a new segment the numbers go on behind the last one that the server heard", () => {
  const storage = new MemoryStorage();
  const before = openOutbox(storage);
  before.setTime("a", 0, true, 0);
  for (let i = 0; i < 5; i++) before.add({ t: "tick" });
  before.acknowledge(2);
  const outbox = openOutbox(storage);
  assert.equal(outbox.first, 3);
  outbox.setTime("b", 0, true, 2);
  assert.equal(outbox.add({ t: "tick" }), 3);
});

test("a page that was given to another person keeps nothing from then on", () => {
  const storage = new MemoryStorage();
  const outbox = openOutbox(storage);
  outbox.setTime("a", 0, true, 0);
  outbox.add({ t: "tick" });
  outbox.discard();
  assert.equal(outbox.add({ t: "tick" }), 0);
  outbox.save();
  assert.equal(storage.length, 0);
});

for (const commits of [1, 2, 3, 4, 5, 6]) {
  test(`a tab that is killed after ${commits} commits leaves messages without a gap, and the next goes on behind them`, async () => {
    const database = new SlowDatabase();
    const before = openOutbox();
    await before.recover(new MessageStore(database, "seat"));
    before.setTime("a", 0, true, 0);
    let done = 0;
    for (let n = 1; n <= 5; n++) {
      before.add({ t: "tick" });
      await Promise.resolve();
      while (done < commits && database.commit()) done++; // at rest before the next, until it is killed
    }
    const outbox = openOutbox();
    const store = new MessageStore(database, "seat");
    await outbox.recover(store);
    assert.ok(outbox.size > 0);
    outbox.setTime("a", 1e9, true, 0);
    outbox.add({ t: "tick" });
    const numbers = outbox.list().map(({ n }) => n);
    assert.deepEqual(numbers, numbers.map((_, i) => i + 1));
    assert.equal(new Set(outbox.list().map(({ at }) => at)).size, numbers.length);
  });
}

test("what a killed tab sent and did not keep is not numbered a second time", async () => {
  const database = new SlowDatabase();
  const before = openOutbox();
  await before.recover(new MessageStore(database, "seat"));
  before.setTime("a", 0, true, 0);
  for (let n = 1; n <= 3; n++) {
    before.add({ t: "tick" });
    await Promise.resolve();
  }
  database.commit();
  const outbox = openOutbox();
  await outbox.recover(new MessageStore(database, "seat"));
  outbox.setTime("a", 1e9, true, 3);
  assert.deepEqual(numbersOf(outbox.takeUnacknowledged(3)), []);
  assert.equal(outbox.add({ t: "tick" }), 4);
});

const key = (name) => ({ t: "key", key: name, down: true, stamp: 0 });
const keysOf = (outbox) => outbox.list().map(({ n, what }) => `${n} ${what.key ?? what.t}`);

async function openStored(database, storage = new MemoryStorage()) {
  const outbox = openOutbox(storage);
  await outbox.recover(new MessageStore(database, "seat"));
  return outbox;
}

test("a tab that the browser restores has what it kept last, though its own storage is older", async () => {
  const database = new SlowDatabase(), storage = new MemoryStorage();
  const before = await openStored(database, storage);
  before.setTime("a", 0, true, 0);
  before.add(key("1"));
  await database.settle();
  const older = copyOf(storage);
  clock.ms += 4000;
  before.acknowledge(1);
  before.add(key("2"));
  before.add(key("3"));
  await database.settle();
  const outbox = await openStored(database, older);
  assert.deepEqual(keysOf(outbox), ["1 1", "2 2", "3 3"]);
  outbox.setTime("a", 5e9, true, 0);
  await database.settle();
  const again = await openStored(database);
  assert.deepEqual(keysOf(again), ["1 1", "2 2", "3 3"]);
});

test("what another tab of the link left has no gap to the rest", async () => {
  const database = new SlowDatabase();
  const first = await openStored(database);
  first.setTime("a", 0, true, 0);
  for (let i = 0; i < 56; i++) first.add({ t: "tick" });
  first.acknowledge(56);
  await database.settle();
  const second = await openStored(database);
  second.setTime("a", 1e9, true, 0);
  second.catchUp(2e9);
  first.add({ t: "tick" });
  await database.settle();
  for (let i = 0; i < 11; i++) second.add({ t: "tick" });
  second.acknowledge(11);
  second.add(key("1"));
  await database.settle();
  const numbers = (await openStored(database)).list().map(({ n }) => n);
  assert.deepEqual(numbers, [12, 13]);
});

test("a tab that was sent away adds nothing", () => {
  const outbox = openOutbox();
  outbox.setTime("a", 0, true, 0);
  outbox.isStopped = true;
  assert.equal(outbox.add({ t: "tick" }), 0);
  assert.equal(outbox.size, 0);
});

test("what a transaction could not keep is kept by the next", async () => {
  const database = new SlowDatabase();
  const before = await openStored(database);
  before.setTime("a", 0, true, 0);
  for (const [name, isDone] of [["1", true], ["2", false], ["3", true]]) {
    before.add(key(name));
    await Promise.resolve();
    database.commit(isDone);
    await Promise.resolve();
  }
  assert.deepEqual(keysOf(await openStored(database)), ["1 1", "2 2", "3 3"]);
});

test("what a tab's full storage had no room for is there when it is loaded again", async () => {
  const database = new SlowDatabase(), storage = new MemoryStorage();
  const before = await openStored(database, storage);
  before.setTime("a", 0, true, 0);
  before.add(key("1"));
  const { setItem } = MemoryStorage.prototype;
  storage.setItem = (name, value) => {
    if (name === "m2") throw new Error("QuotaExceededError");
    setItem.call(storage, name, value);
  };
  before.add(key("2"));
  before.add(key("3"));
  await database.settle();
  assert.deepEqual(keysOf(await openStored(database, storage)), ["1 1", "2 2", "3 3"]);
});
