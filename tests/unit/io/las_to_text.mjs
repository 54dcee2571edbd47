// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What the npm package copc reads from a LAS file: lines "count N", "scale X Y Z", "min ..", "max ..", then one per point:
// x y z label reason score confidence yaw red green blue. For tests: node las_to_text.mjs FOLDER_OF_COPC FILE
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { resolve } from 'node:path';

const [folder, file] = process.argv.slice(2);
const { Las } = createRequire(import.meta.url)(resolve(folder));
const bytes = readFileSync(file);
const header = Las.Header.parse(bytes);
const records = await Las.Vlr.walk(file, header);
const extra = Las.ExtraBytes.parse(await Las.Vlr.fetch(file, Las.Vlr.at(records, 'LASF_Spec', 4)));
const { pointDataOffset, pointDataRecordLength, pointCount } = header;
const end = pointDataOffset + pointCount * pointDataRecordLength;
const view = Las.View.create(bytes.subarray(pointDataOffset, end), header, extra);
const names = ['X', 'Y', 'Z', 'label', 'reason', 'score', 'confidence', 'yaw', 'Red', 'Green', 'Blue'];
const columns = names.map((name) => view.getter(name));
const lines = [`count ${pointCount}`, ...['scale', 'min', 'max'].map((key) => `${key} ${header[key].join(' ')}`)];
for (let n = 0; n < pointCount; ++n) lines.push(columns.map((column) => column(n)).join(' '));
process.stdout.write(lines.join('\n') + '\n');
