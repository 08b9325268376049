// Read a file with one of the packages that JavaScript's users take, and print its cells as JSON.
//
// node read_tables.mjs READER FILE
//
// A BigInt is printed as {"integer": "digits"}, a Date as {"milliseconds": number}. `test_javascript.py` runs it in a
// folder that has the packages.

import { open, readFile } from "node:fs/promises";

const readers = {
  async hyparquet(path) {
    const { asyncBufferFromFile, parquetReadObjects } = await import("hyparquet");
    const { compressors } = await import("hyparquet-compressors");
    return parquetReadObjects({ file: await asyncBufferFromFile(path), compressors });
  },

  async "hyparquet-microseconds"(path) {
    const { asyncBufferFromFile, parquetReadObjects } = await import("hyparquet");
    const { compressors } = await import("hyparquet-compressors");
    const parsers = { timestampFromMicroseconds: (microseconds) => microseconds };
    return parquetReadObjects({ file: await asyncBufferFromFile(path), compressors, parsers });
  },

  async "parquet-wasm"(path) {
    const { readParquet } = await import("parquet-wasm");
    const { tableFromIPC } = await import("apache-arrow");
    const table = tableFromIPC(readParquet(new Uint8Array(await readFile(path))).intoIPCStream());
    return table.toArray().map((row) => row.toJSON());
  },

  async "d3-auto"(path) {
    const { autoType, csvParse } = await import("d3-dsv");
    return [...csvParse(await readFile(path, "utf8"), autoType)];
  },

  async "papa-auto"(path) {
    const { default: Papa } = await import("papaparse");
    return Papa.parse(await readFile(path, "utf8"), { header: true, dynamicTyping: true, skipEmptyLines: true }).data;
  },

  async mcap(path) {
    const { McapIndexedReader } = await import("@mcap/core");
    const { loadDecompressHandlers } = await import("@mcap/support");
    const { FileHandleReadable } = await import("@mcap/nodejs");
    const { default: protobuf } = await import("protobufjs");
    const { default: descriptor } = await import("protobufjs/ext/descriptor.js");
    const handle = await open(path, "r");
    const reader = await McapIndexedReader.Initialize({
      readable: new FileHandleReadable(handle),
      decompressHandlers: await loadDecompressHandlers(),
    });
    const types = new Map();
    for (const schema of reader.schemasById.values()) {
      const files = descriptor.FileDescriptorSet.decode(schema.data);
      types.set(schema.id, protobuf.Root.fromDescriptor(files).lookupType(schema.name));
    }
    const messages = [];
    for await (const message of reader.readMessages()) {
      const channel = reader.channelsById.get(message.channelId);
      const type = types.get(channel.schemaId);
      const fields = type.toObject(type.decode(message.data), { longs: String, enums: Number, bytes: String, json: true });
      messages.push({ topic: channel.topic, logTime: message.logTime, publishTime: message.publishTime, fields });
    }
    await handle.close();
    return messages;
  },
};

function describeCell(key, cell) {
  const original = this[key]; // a Date is a text by now
  if (typeof original === "bigint") return { integer: original.toString() };
  if (original instanceof Date) return { milliseconds: original.getTime() };
  return cell;
}

const [reader, path] = process.argv.slice(2);
process.stdout.write(JSON.stringify(await readers[reader](path), describeCell));
