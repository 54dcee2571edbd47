// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What the npm packages @mcap/core and protobufjs read from an MCAP file, by its index and from beginning to end; the
// messages by the schemas that are in the file. For tests: node mcap_to_text.mjs NPM_FOLDER FILE
// Lines: "indexed TOPIC SCHEMA" and "streamed TOPIC SCHEMA" for each message; "frame PARENT CHILD X Y Z"; "cloud FRAME",
// "field NAME TYPE" for each, "point NUMBER..." for each; "arrow X Y Z  TX TY TZ" from where to where.
import { open, readFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { resolve } from 'node:path';

const [npm, file] = process.argv.slice(2);
const require = createRequire(resolve(npm, 'package.json'));
const { McapIndexedReader, McapStreamReader } = require('@mcap/core');
const protobuf = require('protobufjs');
const { FileDescriptorSet } = require('protobufjs/ext/descriptor');

const lines = [];
const types = new Map();
function typeOf(schema) {
  if (!types.has(schema.name)) {
    types.set(schema.name, protobuf.Root.fromDescriptor(FileDescriptorSet.decode(schema.data)).lookupType(schema.name));
  }
  return types.get(schema.name);
}

const handle = await open(file);
const readable = {
  size: async () => BigInt((await handle.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await handle.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({ readable });
const decoded = [];
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId), schema = reader.schemasById.get(channel.schemaId);
  lines.push(`indexed ${channel.topic} ${schema.name}`);
  decoded.push([schema.name, typeOf(schema).decode(message.data)]);
}
if (Number(reader.statistics.messageCount) !== decoded.length) throw new Error('another count in the statistics');

const stream = new McapStreamReader({ validateCrcs: true });
stream.append(await readFile(file));
const channels = new Map(), schemas = new Map();
for (let record = stream.nextRecord(); record; record = stream.nextRecord()) {
  if (record.type === 'Schema') schemas.set(record.id, record.name);
  if (record.type === 'Channel') channels.set(record.id, record);
  if (record.type !== 'Message') continue;
  const channel = channels.get(record.channelId);
  lines.push(`streamed ${channel.topic} ${schemas.get(channel.schemaId)}`);
}
if (!stream.done()) throw new Error('the file does not end as it should');

const NUMBERS = [null, ['Uint8', 1], ['Int8', 1], ['Uint16', 2], ['Int16', 2], ['Uint32', 4], ['Int32', 4], ['Float32', 4], ['Float64', 8]];
/// v turned by q.
function turned(q, v) {
  const u = [q.y * v[2] - q.z * v[1] + q.w * v[0], q.z * v[0] - q.x * v[2] + q.w * v[1], q.x * v[1] - q.y * v[0] + q.w * v[2]];
  const r = [q.y * u[2] - q.z * u[1], q.z * u[0] - q.x * u[2], q.x * u[1] - q.y * u[0]];
  return v.map((value, axis) => value + 2 * r[axis]);
}
for (const [name, message] of decoded) {
  if (name === 'foxglove.FrameTransform') {
    const { x, y, z } = message.translation;
    lines.push(`frame ${message.parent_frame_id} ${message.child_frame_id} ${x} ${y} ${z}`);
  } else if (name === 'foxglove.PointCloud') {
    lines.push(`cloud ${message.frame_id}`);
    for (const field of message.fields) lines.push(`field ${field.name} ${NUMBERS[field.type][0]}`);
    const view = new DataView(message.data.buffer, message.data.byteOffset, message.data.byteLength);
    for (let at = 0; at < view.byteLength; at += message.point_stride) {
      lines.push('point ' + message.fields.map((field) => view[`get${NUMBERS[field.type][0]}`](at + field.offset, true)).join(' '));
    }
  } else if (name === 'foxglove.SceneUpdate') {
    for (const { arrows, frame_id: frame } of message.entities) {
      if (frame !== 'map') throw new Error(`arrows in the frame ${frame}`);
      for (const { pose, shaft_length: shaft, head_length: head } of arrows) {
        const from = [pose.position.x, pose.position.y, pose.position.z];
        const along = turned(pose.orientation, [shaft + head, 0, 0]);
        lines.push('arrow ' + [...from, ...from.map((value, axis) => value + along[axis])].join(' '));
      }
    }
  }
}
process.stdout.write(lines.join('\n') + '\n');
