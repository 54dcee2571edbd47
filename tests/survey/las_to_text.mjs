// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What the npm package copc reads from a LAS file: "count N", "date YEAR DAY", "encoding N", "wkt TEXT", then one line of
// numbers per point, of the dimensions that are named. For tests: node las_to_text.mjs FOLDER_OF_COPC FILE DIMENSION...
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { resolve } from 'node:path';

const [folder, file, ...names] = process.argv.slice(2);
const { Las } = createRequire(import.meta.url)(resolve(folder));
const bytes = readFileSync(file);
const header = Las.Header.parse(bytes);
const records = await Las.Vlr.walk(file, header);
const text = async (user, id) => {
  const record = Las.Vlr.find(records, user, id);
  return record ? Buffer.from(await Las.Vlr.fetch(file, record)).toString('latin1').replace(/\0$/, '') : '';
};
const extra = Las.ExtraBytes.parse(await Las.Vlr.fetch(file, Las.Vlr.at(records, 'LASF_Spec', 4)));
const { pointDataOffset, pointDataRecordLength, pointCount } = header;
const end = pointDataOffset + pointCount * pointDataRecordLength;
const view = Las.View.create(bytes.subarray(pointDataOffset, end), header, extra);
const columns = names.map((name) => view.getter(name));
const lines = [`count ${pointCount}`, `date ${header.fileCreationYear} ${header.fileCreationDayOfYear}`,
               `encoding ${header.globalEncoding}`, `wkt ${await text('LASF_Projection', 2112)}`];
for (let n = 0; n < pointCount; ++n) lines.push(columns.map((column) => column(n)).join(' '));
process.stdout.write(lines.join('\n') + '\n');
