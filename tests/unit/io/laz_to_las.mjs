// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Writes a LAZ file as LAS to standard output, by the npm package laz-perf: a decoder that shares no code with the
// project.   node laz_to_las.mjs FOLDER_OF_LAZ_PERF IN.laz
import { readFileSync, writeSync } from 'node:fs';
import { createRequire } from 'node:module';
import { resolve } from 'node:path';

const [folder, file] = process.argv.slice(2);
const require = createRequire(import.meta.url);
const { createLazPerf } = require(resolve(folder, 'lib/node/index.js'));

function writeAll(bytes) {
  for (let at = 0; at < bytes.length; ) {
    try {
      at += writeSync(1, bytes, at);
    } catch (error) {
      if (error.code !== 'EAGAIN') throw error;
    }
  }
}

const packed = readFileSync(file);
const module = await createLazPerf();
const input = module._malloc(packed.length);
module.HEAPU8.set(packed, input);
const decoder = new module.LASZip();
decoder.open(input, packed.length);
const recordBytes = decoder.getPointLength();
const point = module._malloc(recordBytes);

const header = Buffer.from(packed.subarray(0, packed.readUInt32LE(96)));
header[104] &= 0x3f; // the two bits that mark compressed points
writeAll(header);
const count = decoder.getCount();
const block = 4096;
for (let first = 0; first < count; first += block) {
  const here = Math.min(block, count - first);
  const records = Buffer.alloc(here * recordBytes);
  for (let i = 0; i < here; ++i) {
    decoder.getPoint(point);
    records.set(module.HEAPU8.subarray(point, point + recordBytes), i * recordBytes);
  }
  writeAll(records);
}
