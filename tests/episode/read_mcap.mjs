// Reads an MCAP file with the libraries that Foxglove itself reads with; prints what it finds as JSON.
import { open } from "node:fs/promises";
import { createRequire } from "node:module";
const require = createRequire(process.argv[3] + "/");
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { loadDecompressHandlers } = require("@mcap/support");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");

const file = await open(process.argv[2], "r");
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers: await loadDecompressHandlers(),
});
const decoders = new Map();
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  if (channel.messageEncoding !== "cdr" || schema.encoding !== "ros2msg") throw new Error(channel.topic);
  const definition = parse(new TextDecoder().decode(schema.data), { ros2: true });
  decoders.set(channel.id, new MessageReader(definition));
}
const found = {};
for await (const message of reader.readMessages()) {
  const topic = reader.channelsById.get(message.channelId).topic;
  const value = decoders.get(message.channelId).readMessage(message.data);
  found[topic] ??= { count: 0, first: value, first_ns: message.logTime };
  found[topic].count += 1;
  found[topic].last = value;
  found[topic].last_ns = message.logTime;
}
const plain = (_, v) => typeof v === "bigint" ? Number(v) : ArrayBuffer.isView(v) ? Array.from(v) : v;
console.log(JSON.stringify(found, plain));
await file.close();
