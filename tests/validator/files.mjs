// What the scripts of this folder know about glTF files: their JSON, and what the Khronos validator says.
import { readFile } from 'node:fs/promises';
import { dirname, resolve } from 'node:path';
import { validateBytes } from 'gltf-validator';

/** The JSON of a .gltf or .glb. */
export async function json(path) {
  const bytes = await readFile(path);
  const isContainer = bytes.subarray(0, 4).toString('latin1') === 'glTF';
  return JSON.parse(isContainer ? bytes.subarray(20, 20 + bytes.readUInt32LE(12)) : bytes);
}

/** Errors and warnings of the validator: `error CODE` or `warning CODE`, how often, and where first. */
async function issues(path) {
  const report = await validateBytes(new Uint8Array(await readFile(path)), {
    maxIssues: 100000,
    externalResourceFunction: (uri) => readFile(resolve(dirname(path), decodeURIComponent(uri))),
  });
  const found = new Map();
  for (const { code, severity, pointer } of report.issues.messages) {
    if (severity > 1) continue;
    const key = `${severity === 0 ? 'error' : 'warning'} ${code}`;
    const entry = found.get(key) ?? { count: 0, pointer };
    entry.count += 1;
    found.set(key, entry);
  }
  return found;
}

/** Whether the validator finds no error in a baked file that its input does not have; says what it found. */
export async function addsNoError(input, output) {
  const [before, after] = [await issues(input), await issues(output)];
  let clean = true;
  for (const [key, { count, pointer }] of after) {
    const had = before.get(key)?.count ?? 0;
    if (count <= had) continue;
    console.error(`${output}: ${key} ${count} times, ${had} before the bake, first at ${pointer}`);
    if (key.startsWith('error')) clean = false;
  }
  return clean;
}
