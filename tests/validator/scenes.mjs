// Folders of scenes before and after a bake: the Khronos validator finds no new error, and glTF-Transform
// inspects and copies every output without losing the light.
//   node scenes.mjs IN_DIR OUT_DIR      (files of the same names)
import { execFile } from 'node:child_process';
import { mkdtemp, readdir, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { promisify } from 'node:util';
import { addsNoError, json } from './files.mjs';

const run = promisify(execFile);
const TRANSFORM = fileURLToPath(new URL('node_modules/.bin/gltf-transform', import.meta.url));
const [inputs, outputs] = process.argv.slice(2);
if (!outputs) {
  console.error('usage: scenes.mjs IN_DIR OUT_DIR');
  process.exit(1);
}

async function transform(...args) {
  try {
    await run(TRANSFORM, args, { maxBuffer: 1 << 28 });
    return true;
  } catch (error) {
    console.error(`gltf-transform ${args.join(' ')}: ${error.stdout}${error.stderr}`);
    return false;
  }
}

/** How many attributes of primitives carry light, and how many light values they have. */
async function light(path) {
  const root = await json(path);
  const primitives = root.meshes.flatMap((mesh) => mesh.primitives);
  const isLight = ([name]) => /^_LIGHTUV(_\d+)?$/.test(name);
  const accessors = primitives.flatMap((p) => Object.entries(p.attributes).filter(isLight).map(([, a]) => a));
  return { attributes: accessors.length, values: accessors.reduce((n, a) => n + root.accessors[a].count, 0) };
}

const scratch = await mkdtemp(join(tmpdir(), 'lightkiln-copies-'));
let [passed, failed] = [0, 0];
for (const name of (await readdir(inputs)).filter((n) => /\.(glb|gltf)$/.test(n)).sort()) {
  const [input, output, copy] = [join(inputs, name), join(outputs, name), join(scratch, name)];
  try {
    let clean = await addsNoError(input, output);
    clean = (await transform('inspect', output)) && clean;
    if (await transform('copy', output, copy)) {
      const [ours, theirs] = [await light(output), await light(copy)];
      if (ours.attributes !== theirs.attributes || theirs.values === 0) {
        console.error(`${name}: light ${JSON.stringify(ours)}, after a copy ${JSON.stringify(theirs)}`);
        clean = false;
      }
    } else {
      clean = false;
    }
    clean ? (passed += 1) : (failed += 1);
  } catch (error) {
    failed += 1;
    console.error(`${name}: ${error.message}`);
  }
}
await rm(scratch, { recursive: true });
console.log(`scenes: ${passed} passed, ${failed} failed`);
process.exitCode = failed > 0 || passed === 0 ? 1 : 0;
